"""The formation model (10), linearised about the straight motion, for a linear design."""

from __future__ import annotations

import numpy as np

from formation_controllers.analysis.formation_model import COSINE_MIN, FormationModel, ReducedDynamics, formation_model
from formation_controllers.analysis.small_matrices import inverse, product, solve
from formation_controllers.dynamics import ModelGains
from formation_controllers.elementary import cos, sin
from formation_controllers.errors import ControllerError
from formation_controllers.interface import Floats, Leader
from formation_controllers.kinematics import geometry_of
from formation_controllers.vehicles import Vehicle


def linearised(
    vehicle: Vehicle, model: ModelGains, v_0: float, rho: float, bearing: float
) -> tuple[Floats, Floats, Floats]:
    """Linearise the formation model (10) about the straight motion: M epsilon_ddot + D epsilon_dot + K epsilon = u.

    Leader and robot are aligned at a speed v_0, wheels straight, at a range and a bearing.

    Parameters
    ----------
    vehicle
        The vehicle of robot and leader.
    model
        Parameters of its reduced dynamics.
    v_0
        Speed [m/s].
    rho, bearing
        Range [m] and bearing [rad].

    Returns
    -------
    A : ndarray
        Shape (4, 4), of the state (epsilon, epsilon_dot).
    B : ndarray
        Shape (4, 2), of the formation force u.
    M : ndarray
        Inertia of (10), shape (2, 2).

    Raises
    ------
    ControllerError
        If the range is zero or the bearing is 90 degrees, where R is singular.
    """
    if rho <= 0 or abs(cos(bearing)) < COSINE_MIN:
        raise ControllerError(f"a range of {rho:g} m at a bearing of {bearing:g} rad is singular, (8)")
    reduced = ReducedDynamics.of_vehicle(vehicle, model)
    ahead = geometry_of(vehicle).ahead
    own, leader_velocity = np.zeros(len(vehicle.pose)), np.array([v_0, 0.0])

    def model_at(q_1: float, q_2: float) -> FormationModel:
        leader = own.copy()
        leader[:2] = ahead + q_1 * cos(q_2), q_1 * sin(q_2)
        return formation_model(own, Leader(leader, leader_velocity), np.zeros(2), vehicle, reduced, exact=True)

    def held(q_1: float, q_2: float) -> Floats:
        """Return the formation force that holds range and bearing, less the one that keeps the leader's pace."""
        here = model_at(q_1, q_2)
        return here.f - solve(here.R.T, product(reduced.at(own)[1], leader_velocity))

    here, step = model_at(rho, bearing), 1e-5
    stiffness = np.column_stack(
        [
            held(rho + step, bearing) - held(rho - step, bearing),
            held(rho, bearing + step) - held(rho, bearing - step),
        ]
    ) / (2 * step)
    A = np.block(
        [
            [np.zeros((2, 2)), np.eye(2)],
            [-solve(here.M, stiffness), -solve(here.M, here.C + here.D - here.D_bar)],
        ]
    )
    return A, np.vstack([np.zeros((2, 2)), inverse(here.M)]), here.M
