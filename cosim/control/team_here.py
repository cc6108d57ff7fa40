"""A team whose law runs in this process."""

from __future__ import annotations

from typing import Any

import formation_controllers as fc
import numpy as np
from formation_controllers.controller import Controller
from formation_controllers.interface import CompiledTick
from numpy.typing import NDArray

from cosim.control.host import NotFinite, checked_commands, is_stated, numbers_of, row_of, said
from cosim.control.team import Team
from cosim.errors import InputError, SimulationError


class TeamHere(Team):
    """One controller of this environment with the followers that it serves; see `Team`.

    Raises
    ------
    InputError
        The law refuses the team.
    """

    def _make(self) -> None:
        assert self.law.controller_type is not None
        self._law, source = self.law.controller_type, self.law.source
        try:
            self.controller = self._law(
                fc.Team(self.vehicle, len(self.robots), self.period),
                self.gains[0] if self.shares_gains else self.gains,
            )
        except (Exception, SystemExit) as error:  # a controller is other people's code
            raise InputError(f"controller {source.id!r}: {said(error, self._law)}", source.where) from None
        self._checks_torques = type(self.controller).step is Controller.step
        self._record: NDArray[np.void] | None = None
        self._numbers = np.zeros(0)

    def give(
        self,
        pose: NDArray[np.float64],
        velocity: NDArray[np.float64],
        leader: NDArray[np.float64],
        acceleration: NDArray[np.float64] | None,
        desired: fc.Desired,
    ) -> None:
        """Give the law what it gets at a tick; see `Team.give`."""
        # A controller may keep the arrays that it gets, and write to them.
        own_acceleration = None if acceleration is None else acceleration.copy()
        own_desired = fc.Desired(*(part.copy() for part in desired))
        self._given = pose[self.poses].copy(), self.view.seen(leader.copy(), own_acceleration), own_desired
        self._velocity: dict[str, Any] = {"velocity": velocity[self.velocities].copy()} if self.measured else {}

    def step(self, time: float, *, first: bool) -> NDArray[np.float64]:
        """Return the commands of this tick; see `Team.step`."""
        try:
            if first:
                self.controller.start(*self._given)
            torque: NDArray[np.float64] = self.controller.step(*self._given, **self._velocity)
            if self._checks_torques:
                return torque
            checked: NDArray[np.float64] = checked_commands(torque, (len(self.robots), len(self.vehicle.command)))
        except (Exception, SystemExit) as error:
            raise self._failed(error, time) from error
        return checked

    def telemetry(self, time: float) -> NDArray[np.float64]:
        """Return the controller's signals at the last step; see `Team.telemetry`."""
        try:
            record: NDArray[np.void] = self.controller.telemetry_record
            if record is self._record:
                return self._numbers
            if not self._is_stated(record):
                raise ValueError(f"its telemetry is {record.dtype.names}, not the signals that it states")
        except (Exception, SystemExit) as error:
            raise self._failed(error, time) from error
        numbers: NDArray[np.float64] = numbers_of(record)
        if record.flags.c_contiguous:
            self._record, self._numbers = record, numbers
        return numbers

    def compiled_tick(self) -> CompiledTick | None:
        """Return the law as compiled code can call it; None if it must be called from Python.

        None also for a leader of another kind of vehicle, as the law sees it otherwise than it is.
        """
        try:
            record = self.controller.telemetry_record
            tick = self.controller.compiled_tick()
        except (Exception, SystemExit):  # it will fail again when it is stepped, and be reported there
            return None
        return tick if self._is_stated(record) and record.flags.c_contiguous and self.alike else None

    def restart(self, *made_of: object) -> bool:
        """Lead the law back to before its start; see `Team.restart`."""
        try:
            if made_of != self.made_of or self.compiled_tick() is None:
                return False
            self.controller.reset()
        except (Exception, SystemExit):  # a controller and its gains are other people's code
            return False
        return True

    def not_finite(self, command: NDArray[np.float64], time: float) -> SimulationError:
        """Return the failure of a controller that returned commands (n, entries) which are not finite."""
        return self._failed(self.controller.not_finite(command), time)

    def to_bytes(self, time: float) -> bytes:
        """Return the state of the law; see `Team.to_bytes`."""
        try:
            return self.controller.to_bytes()
        except (Exception, SystemExit) as error:
            raise self._failed(error, time) from error

    def from_bytes(self, state: bytes, time: float) -> None:
        """Let the law go on from a state; see `Team.from_bytes`."""
        try:
            self.controller.from_bytes(state)
        except (Exception, SystemExit) as error:
            raise self._failed(error, time) from error

    def _is_stated(self, record: NDArray[np.void]) -> bool:
        return is_stated(record, self.telemetry_type, len(self.rows))

    def _failed(self, error: BaseException, time: float) -> SimulationError:
        variable = "torque" if isinstance(error, NotFinite) else ""
        return self._failure(row_of(error), f"failed: {said(error, self._law)}", time, variable)
