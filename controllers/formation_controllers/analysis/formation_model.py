"""The second-order formation model (9), (10) of one robot, in NumPy, from any M2, C2, D2 and B2.

M q_ddot + C q_dot + D q_dot - D_bar q_dot + f + tau_d = B tau with q the range and bearing of one robot.

Its properties, for a robot with M2_dot - 2 C2 skew (as all our vehicles have, evaluated at the true velocity):

- Properties 1 and 3 hold where R is regular and D2 is positive definite. Property 2.3 is about C2(R^-1 x): R_dot
  in C is affine in q_dot, not linear, once the leader moves.
- Property 2.1 holds at rest of the leader. With the leader in motion C is evaluated at R^-1 q_dot, which is
  not the velocity but v + R^-1 delta, and x'(M_dot - 2 C) x = -2 y' C2(R^-1 delta) y with y = R^-1 x.
- For a differential-drive robot Properties 2.1 and 2.3 hold whatever the leader does: its C2 is skew itself, and its R
  depends on range and bearing alone.
- Property 2.2 does not hold for C2 of (3). It does for its symmetric part in the two velocities (see
  `ReducedDynamics.symmetrised`), which gives the same C2(v) v; and only with that is (10) with D_bar and f as printed
  exact. Property 2.1 is then lost.
- With ``exact=True``, D_bar has C2(R^-1 delta) R^-1 q_dot + C2(R^-1 q_dot) R^-1 delta where 2 C2(R^-1 delta) R^-1 q_dot
  is printed, so that (10) holds for any C2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from formation_controllers import dynamics, kinematics
from formation_controllers.analysis.small_matrices import inverse, product, solve
from formation_controllers.dynamics import ModelGains
from formation_controllers.elementary import cos
from formation_controllers.errors import ControllerError
from formation_controllers.gains import gain_records
from formation_controllers.geometry import posture_error_rates
from formation_controllers.input_checks import RANGE_BEARING, checked, checked_leader
from formation_controllers.interface import Floats, Leader
from formation_controllers.kinematics import Steering, geometry_of
from formation_controllers.vehicles import Vehicle, names

COSINE_MIN: Final = 1e-9
"""Least magnitude of the bearing's cosine; below it R is taken for singular."""

OfPose: TypeAlias = Floats | Callable[[Floats], ArrayLike]
OfPoseAndVelocity: TypeAlias = Floats | Callable[[Floats, Floats], ArrayLike]


@dataclass(frozen=True)
class ReducedDynamics:
    """M2, C2, D2 and B2 of (3), each a (2, 2) array or a function that returns one.

    Parameters
    ----------
    M2, D2, B2
        Arrays, or functions of a pose (P,).
    C2
        Array (zeros, in effect), or function of a pose (P,) and pseudo-velocities (2,), linear in the latter.
    """

    M2: OfPose
    C2: OfPoseAndVelocity
    D2: OfPose
    B2: OfPose

    @classmethod
    def of_vehicle(cls, vehicle: Vehicle, model: ModelGains | None = None) -> ReducedDynamics:
        """Return the dynamics of `formation_controllers.dynamics` for a vehicle, as functions."""
        car = geometry_of(vehicle)
        own = gain_records([ModelGains() if model is None else model])[0]

        def steering(pose: Floats) -> Steering:
            return kinematics.steering_of(kinematics.steering_angle(kinematics.pose_of(pose, car), car))

        def inertia(pose: Floats) -> Floats:
            return np.reshape(dynamics.inertia(steering(pose), car, own), (2, 2))

        def coriolis(pose: Floats, velocity: Floats) -> Floats:
            return np.reshape(dynamics.coriolis(steering(pose), velocity[0], velocity[1], car, own), (2, 2))

        def damping(pose: Floats) -> Floats:
            return np.diag(dynamics.damping(kinematics.direction_of(pose[2]), steering(pose), car, own))

        def inputs(pose: Floats) -> Floats:
            heading = kinematics.direction_of(pose[2])
            return np.reshape(kinematics.input_matrix(heading, steering(pose), car), (2, 2))

        return cls(inertia, coriolis, damping, inputs)

    def symmetrised(self) -> ReducedDynamics:
        """Return the same dynamics with a C2 for which Property 2.2 holds: C2(x) y = C2(y) x."""

        def coriolis(pose: Floats, velocity: Floats) -> Floats:
            return (self._c2(pose, velocity) + self.swapped(pose, velocity)) / 2

        return ReducedDynamics(self.M2, coriolis, self.D2, self.B2)

    def at(self, pose: Floats) -> tuple[Floats, Floats, Floats]:
        """Return M2, D2 and B2 at a pose."""
        return _matrix("M2", self.M2, pose), _matrix("D2", self.D2, pose), _matrix("B2", self.B2, pose)

    def _c2(self, pose: Floats, velocity: Floats) -> Floats:
        return _matrix("C2", self.C2, pose, velocity)

    def swapped(self, pose: Floats, velocity: Floats) -> Floats:
        """Return the matrix that takes x to C2(x) velocity."""
        return np.column_stack([product(self._c2(pose, axis), velocity) for axis in np.eye(2)])


@dataclass(frozen=True)
class FormationModel:
    """Every matrix of (10) at one instant, and its parts.

    Attributes
    ----------
    M, C, D, D_bar, B : ndarray
        Shape (2, 2).
    f : ndarray
        Shape (2,).
    R, R_dot : ndarray
        R of (8) or (55) and its rate, shape (2, 2).
    delta : ndarray
        Shape (2,).
    velocity : ndarray
        The robot's (v, omega) = R^-1 (q_dot - delta), shape (2,).
    """

    M: Floats
    C: Floats
    D: Floats
    D_bar: Floats
    f: Floats
    B: Floats
    R: Floats
    R_dot: Floats
    delta: Floats
    velocity: Floats

    def force(self, q_dot: ArrayLike, q_ddot: ArrayLike) -> Floats:
        """Return the left-hand side of (10) without disturbance, B tau (2,)."""
        rate = np.asarray(q_dot, dtype=float)
        inertial = product(self.M, np.asarray(q_ddot, dtype=float))
        return inertial + product(self.C + self.D - self.D_bar, rate) + self.f

    def acceleration(self, q_dot: ArrayLike, tau: ArrayLike) -> Floats:
        """Return q_ddot (2,) of (10) under the torques tau (2,)."""
        rest = self.force(q_dot, np.zeros(2))
        return solve(self.M, product(self.B, np.asarray(tau, dtype=float)) - rest)


def formation_model(
    pose: ArrayLike,
    leader: Leader,
    q_dot: ArrayLike,
    vehicle: Vehicle,
    reduced: ReducedDynamics,
    *,
    exact: bool = False,
) -> FormationModel:
    """Return the formation model (10) of one robot at an instant.

    Parameters
    ----------
    pose
        The robot's pose (P,).
    leader
        The virtual leader; without an acceleration it is taken for zero.
    q_dot
        Rates (2,) of range and bearing [m/s, rad/s].
    vehicle
        The vehicle of robot and leader.
    reduced
        The robot's reduced dynamics.
    exact
        Whether D_bar is the one with which (10) holds for any C2, rather than the one printed.

    Raises
    ------
    ControllerError
        If the range is zero or the bearing 90 degrees, where R is singular, a shape does not fit or a number is not
        finite.
    """
    car = geometry_of(vehicle)
    own = checked("pose", pose, (len(vehicle.pose),), names(vehicle.pose))
    rates = checked("q_dot", q_dot, (2,), RANGE_BEARING)
    told, leader_velocity, leader_acceleration = checked_leader(leader, vehicle)
    v_d, omega_d = leader_velocity
    v_d_dot = 0.0 if leader_acceleration is None else float(leader_acceleration[0])

    # Geometry, (4), (7), (8)
    here, there = kinematics.pose_of(own, car), kinematics.pose_of(told, car)
    error = kinematics.posture_error(here, kinematics.direction_of(here.heading), there)
    rho, phi = kinematics.line_of_sight(error.e_1, error.e_2, car.ahead)
    sight, course = kinematics.direction_of(phi), kinematics.direction_of(error.e_3 - phi)
    h = kinematics.steering_of(kinematics.steering_angle(here, car))
    h_d = kinematics.steering_of(kinematics.steering_angle(there, car))
    R = np.reshape(kinematics.rate_matrix(rho, sight, h, car), (2, 2))
    delta = np.array(kinematics.leader_rates(rho, course, v_d))
    if not (np.isfinite(R).all() and abs(cos(phi - h.angle)) >= COSINE_MIN):
        raise ControllerError(f"the formation model is singular at range {rho:g} m and bearing {phi - h.angle:g} rad")
    R_inverse = inverse(R)
    b = product(R_inverse, delta)
    velocity = product(R_inverse, rates) - b

    # (6), (53)
    J, S = posture_error_rates(own, told, vehicle)
    h_d_dot = kinematics.steering_rate(omega_d, kinematics.body_turn(v_d, omega_d, h_d, car), car)

    def b_rate(rho_: float, phi_: float, e_3_: float, h_: float, v_d_: float) -> Floats:
        """Rate of R^-1 delta where these five change at these rates."""
        column = kinematics.rate_matrix_dot(rho, sight, h, rho_, phi_, h_, car)
        shift = kinematics.leader_rates_dot(rho, course, v_d, rho_, e_3_ - phi_, v_d_)
        return product(R_inverse, np.array(shift) - np.array(column) * b[0])

    # d(R^-1 delta)/de, with h = h_d - e_4, + e_3 if it is between two headings; there is no e_4 where nothing steers
    s, c = sight
    turning = 1 if car.steering == kinematics.BY_HEADING else 0
    columns = [b_rate(c, -s / rho, 0, 0, 0), b_rate(s, c / rho, 0, 0, 0), b_rate(0, 0, 1, turning, 0)]
    if car.steering != kinematics.STEERS_NOT:
        columns.append(b_rate(0, 0, 0, -1, 0))
    b_e = np.column_stack([*columns, *np.zeros((len(own) - len(columns), 2))])
    b_v_d, b_h_d = b_rate(0, 0, 0, 0, 1), b_rate(0, 0, 0, 1, 0)

    turn = kinematics.body_turn(velocity[0], velocity[1], h, car)
    h_dot = kinematics.steering_rate(velocity[1], turn, car)
    R_dot = np.zeros((2, 2))
    R_dot[:, 0] = kinematics.rate_matrix_dot(rho, sight, h, rates[0], rates[1] + h_dot, h_dot, car)

    M2, D2, B2 = reduced.at(own)
    a = product(R_inverse, rates)
    c2_a, c2_b = _matrix("C2", reduced.C2, own, a), _matrix("C2", reduced.C2, own, b)
    twice = c2_b + reduced.swapped(own, b) if exact else 2 * c2_b
    to_force = R_inverse.T
    b_rate_of_motion = product(b_e, J, b) - product(b_e, S, leader_velocity) - b_v_d * v_d_dot - b_h_d * h_d_dot
    return FormationModel(
        M=product(to_force, M2, R_inverse),
        C=product(to_force, c2_a - product(M2, R_inverse, R_dot), R_inverse),
        D=product(to_force, D2, R_inverse),
        D_bar=product(to_force, product(M2, b_e, J) + twice, R_inverse),
        f=product(to_force, product(M2, b_rate_of_motion) + product(c2_b, b) - product(D2, b)),
        B=product(to_force, B2),
        R=R,
        R_dot=R_dot,
        delta=delta,
        velocity=velocity,
    )


def _matrix(name: str, value: OfPose | OfPoseAndVelocity, *arguments: Floats) -> Floats:
    matrix = np.asarray(value(*arguments) if callable(value) else value, dtype=float)
    if matrix.shape != (2, 2):
        raise ControllerError(f"{name} has shape {matrix.shape}: expected (2, 2)")
    return matrix
