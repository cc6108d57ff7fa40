"""The reference result of the car-like robot: the matrices printed in (56), by hand. See `plants.reference`.

``python -m plants.car_like.reference`` writes reference.csv beside this file.
"""

from pathlib import Path

import numpy as np

from plants.reference import Array, Reference, accelerations


def drive(t: float) -> Array:
    """Return the inputs of a communication step that begins at time t, (6,)."""
    torques = [15.0 + 10.0 * np.sin(t), 12.0 * np.cos(1.7 * t)]
    return np.array([*torques, 3.0 * np.sin(2.0 * t), -2.0, 1.5 * np.cos(t), 0.5 * np.sin(5.0 * t)])


def rhs(
    x: Array,
    u: Array,
    a: float = 1.2,
    m_c: float = 30.0,
    I_c: float = 5.0,
    I_f: float = 10.0,
    d: tuple[float, float, float, float] = (25.0, 25.0, 25.0, 25.0),
    l_c: float = 0.55,
    drive: str = "as_printed",
) -> Array:
    """Return der(x), (6,), by solving (1) for accelerations and constraint forces together."""
    _, _, psi, gamma, v, omega = x
    s, c = np.sin(psi), np.cos(psi)
    s_front, c_front = np.sin(psi + gamma), np.cos(psi + gamma)
    psi_dot = v * np.tan(gamma) / a
    eta_dot = np.array([v * c, v * s, psi_dot, omega])

    mass_arm = m_c * l_c
    M1 = np.array(
        [
            [m_c, 0.0, -mass_arm * s, 0.0],
            [0.0, m_c, mass_arm * c, 0.0],
            [-mass_arm * s, mass_arm * c, I_c + I_f, I_f],
            [0.0, 0.0, I_f, I_f],
        ]
    )
    C1_eta_dot = np.array([-mass_arm * psi_dot**2 * c, -mass_arm * psi_dot**2 * s, 0.0, 0.0])
    driven = {
        "as_printed": [c, s, a * s],
        "front_wheel": [c_front, s_front, a * np.sin(gamma)],
        "rear_wheel": [c, s, 0.0],
    }
    B1 = np.array([[*driven[drive], 0.0], [0.0, 0.0, 0.0, 1.0]]).T
    # No axle slips sideways: the rear one at (x, y), the front one at a distance a ahead, turned by gamma.
    A = np.array([[s, -c, 0.0, 0.0], [s_front, -c_front, -a * np.cos(gamma), 0.0]])
    turn = psi_dot + omega
    A_dot = np.array(
        [[c * psi_dot, s * psi_dot, 0.0, 0.0], [c_front * turn, s_front * turn, a * np.sin(gamma) * omega, 0.0]]
    )

    force = B1 @ u[:2] - C1_eta_dot - np.array(d) * eta_dot - u[2:]
    eta_ddot = accelerations(M1, force, A, A_dot, eta_dot)
    return np.array([*eta_dot, c * eta_ddot[0] + s * eta_ddot[1], eta_ddot[3]])


REFERENCE = Reference(
    file=Path(__file__).with_name("reference.csv"),
    states=("x", "y", "psi", "gamma", "v", "omega"),
    inputs=("tau_drive", "tau_steer", "tau_d_x", "tau_d_y", "tau_d_psi", "tau_d_gamma"),
    start=(1.0, -2.0, 0.5, -0.2, 0.3, 0.1),
    drive=drive,
    rhs=rhs,
)

if __name__ == "__main__":
    REFERENCE.write()
