"""The base class of compiled laws of range and bearing: it owns their records and calls them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Generic, TypeAlias

import numpy as np

from formation_controllers.columns import columns
from formation_controllers.compiled import compiled_for
from formation_controllers.controller import Controller, G
from formation_controllers.errors import ControllerError
from formation_controllers.gains import gain_records
from formation_controllers.geometry import first_range_bearing
from formation_controllers.interface import CompiledStart, CompiledTick, Desired, Floats, Leader, Team, TickInputs
from formation_controllers.kinematics import geometry_of
from formation_controllers.robot_view import SEEN
from formation_controllers.team_records import TeamRecords
from formation_controllers.vehicles import OTHERS, VEHICLES, states_all

__all__ = ["CompiledLaw", "TeamRecords", "Tick"]

Tick: TypeAlias = Callable[[TickInputs, TeamRecords, Floats], None]
"""A compiled law: fills the torques of a team and its telemetry, and advances its state by one period."""


class CompiledLaw(Controller[G], Generic[G]):
    """A law of range and bearing whose tick is one compiled function.

    It serves every vehicle that states its `FormationGeometry` and its `TorqueMap`, whatever its kind. To write one,
    state `tick`, `begin`, `gains_type` and `signals`, and implement `own_state_shapes`.

    Attributes
    ----------
    tick : callable
        One tick of a team: a compiled function of inputs, records and the torques to fill in.
    begin : callable or None
        The start of a team: a compiled function of inputs and records, which sets the state; it is zero before, but for
        the states `prepared`. A law that has none implements `start_states`.
    prepared : tuple of str
        States that `begin` leaves as they are. The class that states them has an `on_start`, which sets these states,
        then calls `CompiledLaw.on_start`, and sets no others.
    """

    interface: ClassVar[str] = "1.4"
    vehicles: ClassVar[tuple[str, ...]] = (*(vehicle.kind for vehicle in VEHICLES), OTHERS)
    tick: ClassVar[staticmethod[[TickInputs, TeamRecords, Floats], None]]
    begin: ClassVar[staticmethod[[TickInputs, TeamRecords], None] | None] = None
    prepared: ClassVar[tuple[str, ...]] = ()

    def __init__(self, team: Team, gains: G | Sequence[G] | None = None) -> None:
        super().__init__(team, gains)
        if not states_all(team.vehicle):
            raise ControllerError(
                f"{type(self).__name__} needs a vehicle that states its formation and torques, which "
                f"{team.vehicle.kind} does not"
            )
        self._records = TeamRecords(
            geometry_of(team.vehicle),
            float(team.period),
            gain_records(self.robot_gains),
            self._state,
            self._telemetry,
            columns(SEEN),
            columns(self.own_columns()),
        )
        self._call: Tick | None = None

    def state_shapes(self) -> dict[str, tuple[int, ...]]:
        """Return name and shape, per robot, of every state of the law."""
        return {"bearing": (), **self.own_state_shapes()}  # the bearing of the last tick, to unwrap the next one

    @abstractmethod
    def own_state_shapes(self) -> dict[str, tuple[int, ...]]:
        """Return name and shape, per robot, of every state but the bearing."""

    def own_columns(self) -> dict[str, tuple[int, ...]]:
        """Return name and shape, per robot, of what the law's tick works out besides `robot_view.see`."""
        return {}

    def on_start(self, pose: Floats, leader: Leader, desired: Desired) -> None:
        """Set the states by `begin`, without one the turn of the bearing; then by `start_states`."""
        begin, more = type(self).begin, type(self).start_states is not CompiledLaw.start_states
        if begin is not None:
            inputs = self._inputs(pose, leader, desired)
            compiled_for(begin, inputs, self._records)(inputs, self._records)
        if begin is None or more:
            q = first_range_bearing(pose, leader.pose, desired.q, self.team.vehicle)
            self._state["bearing"] = q[:, 1]
            self.start_states(q, desired)

    def start_states(self, q: Floats, desired: Desired) -> None:
        """Set those states that do not start at zero and that `begin` does not set, given range and bearing."""

    def on_step(self, pose: Floats, leader: Leader, desired: Desired) -> Floats:
        """Return the torques of this tick, then advance the states."""
        inputs = self._inputs(pose, leader, desired)
        torque = np.empty(self._command_shape)
        if self._call is None:
            self._call = compiled_for(type(self).tick, inputs, self._records, torque)
        self._call(inputs, self._records, torque)
        return torque

    def _inputs(self, pose: Floats, leader: Leader, desired: Desired) -> TickInputs:
        leader_pose, leader_velocity, acceleration = leader
        if acceleration is None:
            acceleration = self._no_acceleration
        return TickInputs(pose, self._velocity, leader_pose, leader_velocity, acceleration, *desired)

    def compiled_tick(self) -> CompiledTick | None:
        """Return the law's tick and its records, unless a subclass steps in another way."""
        if not self._is_as_here("step", "on_step", "telemetry_record", "_checked", "_checked_velocity", "_inputs"):
            return None
        return CompiledTick(type(self).tick, self._records)

    def compiled_start(self) -> CompiledStart | None:
        """Return the law's start and its records, unless it has none or a subclass starts in another way.

        A class with states `prepared` sets them in an `on_start` of its own. A subclass of it with another `on_start`,
        or with other such states, states both.
        """
        own = type(self)
        starting = vars(next(one for one in own.__mro__ if "on_start" in vars(one)))
        prepares = bool(own.prepared) and starting.get("prepared") == own.prepared and "on_start" not in vars(self)
        if own.begin is None or not (prepares or self._is_as_here("on_start")):
            return None
        if not self._is_as_here("start", "start_states", "_checked", "_inputs", "_clear"):
            return None
        return CompiledStart(own.begin, self._records, own.prepared)

    def _is_as_here(self, *names: str) -> bool:
        """Tell whether neither a subclass nor this object has something else under names of this class."""
        own = type(self)
        return all(getattr(own, name) is getattr(CompiledLaw, name) and name not in vars(self) for name in names)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the compiled code, which another process has at another place."""
        return {**self.__dict__, "_call": None}
