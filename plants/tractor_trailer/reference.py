"""The reference result of the tractor-trailer: the matrices printed in (57), by hand. See `plants.reference`.

``python -m plants.tractor_trailer.reference`` writes reference.csv beside this file.
"""

from pathlib import Path

import numpy as np

from plants.reference import Array, Reference, accelerations


def drive(t: float) -> Array:
    """Return the inputs of a communication step that begins at time t, (6,)."""
    forward, turn = 1.5 + np.sin(t), 3.0 * np.cos(1.7 * t)
    return np.array(
        [forward + turn, forward - turn, 3.0 * np.sin(2.0 * t), -2.0, 1.5 * np.cos(t), 0.5 * np.sin(5.0 * t)]
    )


def rhs(
    x: Array,
    u: Array,
    m_0: float = 15.0,
    m_1: float = 15.0,
    I_0: float = 2.0,
    I_1: float = 2.0,
    r: float = 0.15,
    b: float = 0.4,
    a_0: float = 0.15,
    a_1: float = 0.05,
    d: float = 1.5,
    d_m: tuple[float, float, float, float] = (25.0, 25.0, 25.0, 25.0),
) -> Array:
    """Return der(x), (6,), by solving (1) for accelerations and constraint forces together."""
    _, _, theta_1, theta_0, v, omega = x
    s_1, c_1, s_0, c_0 = np.sin(theta_1), np.cos(theta_1), np.sin(theta_0), np.cos(theta_0)
    s_h, c_h = np.sin(theta_0 - theta_1), np.cos(theta_0 - theta_1)
    theta_1_dot = v * s_h / (d * c_h)
    eta_dot = np.array([v * c_1, v * s_1, theta_1_dot, omega])

    M, L = m_0 + m_1, a_1 * m_1 + d * m_0
    I_theta1, I_theta0 = m_1 * a_1**2 + m_0 * d**2 + I_1, m_0 * a_0**2 + I_0
    arm = a_0 * m_0
    M1 = np.array(
        [
            [M, 0.0, -L * s_1, -arm * s_0],
            [0.0, M, L * c_1, arm * c_0],
            [-L * s_1, L * c_1, I_theta1, arm * d * c_h],
            [-arm * s_0, arm * c_0, arm * d * c_h, I_theta0],
        ]
    )
    C_11 = -arm * c_0 * omega**2 - L * c_1 * theta_1_dot**2
    C_21 = -arm * s_0 * omega**2 - L * s_1 * theta_1_dot**2
    C1_eta_dot = np.array([C_11, C_21, -arm * d * omega**2 * s_h, arm * d * theta_1_dot**2 * s_h])
    B1 = np.array([[c_0, s_0, d * s_h, b], [c_0, s_0, d * s_h, -b]]).T / r
    # No axle slips sideways: the tractor's at the hitch, the trailer's at (x, y).
    A = np.array([[s_0, -c_0, -d * c_h, 0.0], [s_1, -c_1, 0.0, 0.0]])
    hitch_dot = omega - theta_1_dot
    A_dot = np.array(
        [[c_0 * omega, s_0 * omega, d * s_h * hitch_dot, 0.0], [c_1 * theta_1_dot, s_1 * theta_1_dot, 0, 0]]
    )

    force = B1 @ u[:2] - C1_eta_dot - np.array(d_m) * eta_dot - u[2:]
    eta_ddot = accelerations(M1, force, A, A_dot, eta_dot)
    return np.array([*eta_dot, c_1 * eta_ddot[0] + s_1 * eta_ddot[1], eta_ddot[3]])


REFERENCE = Reference(
    file=Path(__file__).with_name("reference.csv"),
    states=("x", "y", "theta_1", "theta_0", "v", "omega"),
    inputs=("tau_right", "tau_left", "tau_d_x", "tau_d_y", "tau_d_theta_1", "tau_d_theta_0"),
    start=(1.0, -2.0, 0.5, 0.2, 0.3, 0.1),
    drive=drive,
    rhs=rhs,
)

if __name__ == "__main__":
    REFERENCE.write()
