"""The reference result of the differential-drive robot, with the wheels' angles as coordinates. See `plants.reference`.

Coordinates (x, y, theta, phi_right, phi_left); three constraints: the axle does not slip sideways, each wheel rolls.
``python -m plants.differential_drive.reference`` writes reference.csv beside this file.
"""

from pathlib import Path

import numpy as np

from plants.reference import Array, Reference, accelerations


def drive(t: float) -> Array:
    """Return the inputs of a communication step that begins at time t, (5,)."""
    forward, turn = 1.5 + np.sin(t), 0.6 * np.cos(1.7 * t)
    return np.array([forward + turn, forward - turn, 3.0 * np.sin(2.0 * t), -2.0, 0.5 * np.cos(t)])


def rhs(
    x: Array,
    u: Array,
    m_c: float = 36.0,
    m_w: float = 2.0,
    I_c: float = 1.83,
    I_w: float = 0.02,
    I_m: float = 0.005,
    c: float = 0.1,
    r: float = 0.1,
    b: float = 0.25,
    d: tuple[float, float, float] = (25.0, 25.0, 2.0),
) -> Array:
    """Return der(x), (5,), by solving (1) for accelerations and constraint forces together."""
    _, _, theta, v, omega = x
    sin, cos = np.sin(theta), np.cos(theta)
    pose_dot = np.array([v * cos, v * sin, omega])
    eta_dot = np.array([*pose_dot, (v + b * omega) / r, (v - b * omega) / r])

    mass, arm = m_c + 2 * m_w, m_c * c
    M1 = np.diag([mass, mass, I_c + m_c * c**2 + 2 * (I_m + m_w * b**2), I_w, I_w])
    M1[0, 2] = M1[2, 0] = -arm * sin
    M1[1, 2] = M1[2, 1] = arm * cos
    centrifugal = -arm * omega**2 * np.array([cos, sin, 0.0])
    A = np.array([[sin, -cos, 0.0, 0.0, 0.0], [cos, sin, b, -r, 0.0], [cos, sin, -b, 0.0, -r]])
    A_dot = np.zeros((3, 5))
    A_dot[:, :2] = omega * np.array([[cos, sin], [-sin, cos], [-sin, cos]])

    force = np.array([*(-centrifugal - np.array(d) * pose_dot - u[2:]), *u[:2]])
    eta_ddot = accelerations(M1, force, A, A_dot, eta_dot)
    return np.array([*pose_dot, cos * eta_ddot[0] + sin * eta_ddot[1], eta_ddot[2]])


REFERENCE = Reference(
    file=Path(__file__).with_name("reference.csv"),
    states=("x", "y", "theta", "v", "omega"),
    inputs=("tau_right", "tau_left", "tau_d_x", "tau_d_y", "tau_d_theta"),
    start=(1.0, -2.0, 0.5, 0.3, 0.1),
    drive=drive,
    rhs=rhs,
)

if __name__ == "__main__":
    REFERENCE.write()
