"""A control law as a scenario asks for it, and the followers that share one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import formation_controllers as fc
import numpy as np
from formation_controllers.controller import Controller
from formation_controllers.interface import CompiledTick
from formation_controllers.vehicles import Vehicle
from numpy.typing import NDArray
from packaging.specifiers import InvalidSpecifier, SpecifierSet

from cosim.control.exception_origin import innermost, told
from cosim.control.installed_laws import installed
from cosim.control.leader_view import alike, as_seen_by
from cosim.errors import InputError, SimulationError
from cosim.scenario.scenario import ControllerSource, Setting


@dataclass(frozen=True)
class Law:
    """A control law that is installed as asked for, with gains that it accepts.

    Attributes
    ----------
    source : ControllerSource
        The controller in the scenario.
    package, version : str
        The distribution that it comes from.
    controller_type : type
        The class, a `formation_controllers.controller.Controller`.
    gains : formation_controllers.Gains
        The gains of followers who have none of their own.
    """

    source: ControllerSource
    package: str
    version: str
    controller_type: type[Controller[Any]]
    gains: fc.Gains


def find_law(source: ControllerSource) -> Law:
    """Find the installed law that a scenario asks for, and check its gains.

    Raises
    ------
    InputError
        It is not installed, comes from another package or in a version that will not do, cannot be loaded, or a gain
        is wrong.
    """
    try:
        found = installed(source.name)
        _check_package(source, found)
    except InputError as error:
        raise InputError(error.message, source.where) from None
    except fc.ControllerError as error:
        raise InputError(str(error), source.where) from None
    try:
        law = found.load()
    except fc.ControllerError as error:
        raise InputError(_imported(error, found), source.where) from None
    return Law(source, found.package, found.version, law, _gains(source.id, law, source.gains))


def gains_of(law: Law, own: Sequence[Setting]) -> fc.Gains:
    """Return the gains of a follower with some of its own.

    Raises
    ------
    InputError
        A gain is wrong, with its place.
    """
    if not own:
        return law.gains
    names = {setting.name for setting in own}
    common = [setting for setting in law.source.gains if setting.name not in names]
    return _gains(law.source.id, law.controller_type, [*common, *own])


class Team:
    """One controller with the followers that it serves.

    Parameters
    ----------
    law
        The control law.
    gains
        Those of each follower.
    robots, rows
        The followers' names, and their rows in the arrays of all followers.
    vehicle
        Their geometry.
    leader
        The leader's geometry.
    period
        Sample period [s].

    Attributes
    ----------
    place : slice or ndarray
        The rows as an index; a slice, which NumPy takes in a fifth of the time, where they are neighbours.
    poses, velocities, commands : tuple
        Their entries in the arrays of all followers as an index: the first ones of each row.
    telemetry_type : numpy.dtype
        The record of the signals that the law states.

    Raises
    ------
    InputError
        The law does not serve this vehicle.
    """

    def __init__(
        self,
        law: Law,
        gains: Sequence[fc.Gains],
        robots: Sequence[str],
        rows: Sequence[int],
        vehicle: Vehicle,
        leader: Vehicle,
        period: float,
    ) -> None:
        self._made_of = (law, tuple(gains), tuple(robots), tuple(rows), vehicle, leader, period)
        self.law = law
        self.robots = tuple(robots)
        self.rows = np.asarray(rows)
        first, last = int(rows[0]), int(rows[-1])
        neighbours = list(rows) == list(range(first, last + 1))
        self.place: slice | NDArray[np.int_] = slice(first, last + 1) if neighbours else self.rows
        self.poses = self._index(len(vehicle.pose))
        self.velocities = self._index(len(vehicle.velocity))
        self.commands = self._index(len(vehicle.command))
        self.vehicle = vehicle
        self.leader = leader
        shared = all(own is gains[0] for own in gains)
        try:
            self.controller = law.controller_type(
                fc.Team(vehicle, len(robots), period), gains[0] if shared else tuple(gains)
            )
        except Exception as error:  # a controller is other people's code
            raise InputError(
                f"controller {law.source.id!r}: {_said(error, law.controller_type)}", law.source.where
            ) from None
        self._alike = alike(vehicle, leader)
        self._checks_torques = type(self.controller).step is Controller.step
        self._record: NDArray[np.void] | None = None
        self._numbers = np.zeros(0)
        signals = law.controller_type.signals
        self.telemetry_type: np.dtype[np.void] = np.dtype(
            [(s.name, np.float64, (len(s.components),) if s.components else ()) for s in signals]
        )

    def _index(self, entries: int) -> tuple[slice | NDArray[np.int_], slice]:
        return self.place, slice(0, entries)

    def step(
        self,
        time: float,
        pose: NDArray[np.float64],
        velocity: NDArray[np.float64],
        leader: NDArray[np.float64],
        acceleration: NDArray[np.float64] | None,
        desired: fc.Desired,
        *,
        first: bool,
    ) -> NDArray[np.float64]:
        """Return the commands (n, entries) of this team's followers, torques [N.m] if their vehicle takes torques.

        Poses and velocities (N, entries) belong to all followers, the desired places to this team. Poses are
        those measured; a law that needs velocities is given the true ones, and no other law any. The leader is its pose
        and pseudo-velocities, one after the other in an array of this tick's own, and its accelerations where they are
        known.

        Raises
        ------
        SimulationError
            The controller refused its input, failed, or returned something other than finite torques.
        """
        own_pose = pose[self.poses].copy()  # a controller may keep the arrays that it gets
        measured = {"velocity": velocity[self.velocities].copy()} if "velocity" in self.controller.needs else {}
        if self._alike:
            entries = len(self.leader.pose)
            seen = fc.Leader(leader[:entries], leader[entries:], acceleration)
        else:
            seen = as_seen_by(self.vehicle, self.leader, leader, acceleration)
        try:
            if first:
                self.controller.start(own_pose, seen, desired)
            torque: NDArray[np.float64] = self.controller.step(own_pose, seen, desired, **measured)
            if self._checks_torques:
                return torque
            torque = np.asarray(torque, dtype=float)
        except (Exception, SystemExit) as error:
            raise self._failure(error, time) from error
        expected = (len(self.robots), len(self.vehicle.command))
        if torque.shape != expected:
            misshapen = ValueError(f"it returned torques of shape {torque.shape}, not {expected}")
            raise self._failure(misshapen, time)
        finite = np.isfinite(torque).all(axis=1)
        if not finite.all():
            row = int(np.argmin(finite))
            wrong = fc.ControllerError(f"the torque is {torque[row].tolist()}: it must be finite", robot=row)
            raise self._failure(wrong, time, "torque")
        return torque

    def telemetry(self, time: float) -> NDArray[np.float64]:
        """Return the controller's signals at the last step: the numbers of one record a follower, one after the other.

        Raises
        ------
        SimulationError
            The controller failed, or returned other signals than it has stated.
        """
        try:
            record: NDArray[np.void] = self.controller.telemetry_record
            if record is self._record:
                return self._numbers
            if not self._is_stated(record):
                raise ValueError(f"its telemetry is {record.dtype.names}, not the signals that it states")
        except (Exception, SystemExit) as error:
            raise self._failure(error, time) from error
        if not record.flags.c_contiguous:
            return record.copy().view(np.float64)
        self._record, self._numbers = record, record.view(np.float64)
        return self._numbers

    def compiled_tick(self) -> CompiledTick | None:
        """Return the law as compiled code can call it; None if it must be called from Python.

        None also for a leader of another kind of vehicle, as the law sees it otherwise than it is.
        """
        try:
            record = self.controller.telemetry_record
            tick = self.controller.compiled_tick()
        except Exception:  # it will fail again when it is stepped, and be reported there
            return None
        return tick if self._is_stated(record) and record.flags.c_contiguous and self._alike else None

    def restart(self, *made_of: object) -> bool:
        """Lead the law back to before its start, for a team that is made of some arguments.

        Returns
        -------
        bool
            Whether that makes it a team as good as new: it is made of the same, and the law states its compiled tick,
            so that all of its numbers are in its records.
        """
        try:
            if made_of != self._made_of or self.compiled_tick() is None:
                return False
            self.controller.reset()
        except Exception:  # a controller and its gains are other people's code
            return False
        return True

    def not_finite(self, command: NDArray[np.float64], time: float) -> SimulationError:
        """Return the failure of a controller that returned commands (n, entries) which are not finite."""
        return self._failure(self.controller.not_finite(command), time)

    def _is_stated(self, record: NDArray[np.void]) -> bool:
        return record.dtype == self.telemetry_type and record.shape == self.rows.shape

    def _failure(self, error: BaseException, time: float, variable: str = "") -> SimulationError:
        row = error.robot if isinstance(error, fc.ControllerError) else None
        robot = self.robots[row] if row is not None else " and ".join(self.robots)
        said = _said(error, self.law.controller_type)
        return SimulationError(robot, time, f"the controller {self.law.source.name!r} failed: {said}", variable)


def _said(error: BaseException, law: type) -> str:
    return error.message if isinstance(error, fc.ControllerError) else told(error, law)


def _imported(error: fc.ControllerError, found: fc.Installed) -> str:
    """Return why a law could not be loaded; where its module failed, with the line."""
    place = ""
    if error.__cause__ is not None:
        place = innermost(error.__cause__, {found.entry_point.module.partition(".")[0]})
    return f"{error}, at {place}" if place else str(error)


def _check_package(source: ControllerSource, found: fc.Installed) -> None:
    if source.package != found.package:
        raise InputError(
            f"the controller {source.name!r} is installed from the package {found.package}, not from {source.package}"
        )
    try:
        wanted = SpecifierSet(source.version)
    except InvalidSpecifier:
        raise InputError(f'version="{source.version}" is no version range, such as "~=0.1.0"') from None
    if not wanted.contains(found.version, prereleases=True):
        raise InputError(
            f"the controller {source.name!r} needs {found.package} {source.version}, "
            f"but version {found.version} is installed"
        )


def _gains(controller: str, law: type[Controller[Any]], settings: Sequence[Setting]) -> fc.Gains:
    values: dict[str, float | tuple[float, ...]] = {}
    for setting in settings:
        numbers = tuple(float(number) for number in setting.value.split())
        values[setting.name] = numbers[0] if len(numbers) == 1 else numbers
        try:  # one by one, so that the error names the line of the gain that is wrong
            gains: fc.Gains = law.gains_type.from_mapping(values)
        except fc.GainError as error:
            raise InputError(f"controller {controller!r}: {error}", setting.where) from None
        except Exception as error:  # the gains are other people's code, too
            raise InputError(f"controller {controller!r}: {told(error, law)}", setting.where) from None
    if not settings:
        gains = law.gains_type()
    return gains
