"""Followers that share a control law and a kind of vehicle, and the controller that serves them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import formation_controllers as fc
import numpy as np
from numpy.typing import NDArray
from packaging.specifiers import InvalidSpecifier, SpecifierSet

from cosim.errors import InputError, SimulationError, nearest
from cosim.scenario import ControllerSource


@dataclass(frozen=True)
class ControllerIdentity:
    """Which code controls: the law, its distribution and that distribution's version."""

    name: str
    package: str
    version: str


def identify(source: ControllerSource) -> ControllerIdentity:
    """Find the installed controller that a scenario asks for.

    Raises
    ------
    InputError
        No installed package offers it (names those that are offered), or not in a version that will do.
    """
    installed = fc.installed()
    if source.name not in installed:
        known = nearest(source.name, list(installed))
        raise InputError(f"no installed package offers a controller {source.name!r}: {known}", source.where)
    found = installed[source.name]
    if source.package is not None and source.package != found.package:
        raise InputError(
            f"the controller {source.name!r} is installed from the package {found.package}, not from {source.package}",
            source.where,
        )
    if source.version is not None:
        try:
            wanted = SpecifierSet(source.version)
        except InvalidSpecifier:
            raise InputError(
                f'version="{source.version}" is no version range, such as "~=0.1.0"', source.where
            ) from None
        if not wanted.contains(found.version, prereleases=True):
            raise InputError(
                f"the controller {source.name!r} needs {found.package} {source.version}, "
                f"but version {found.version} is installed",
                source.where,
            )
    return ControllerIdentity(source.name, found.package, found.version)


class Team:
    """One controller with the followers that it serves.

    Parameters
    ----------
    source
        The control law and its gains.
    robots, rows
        The followers' names, and their rows in the arrays of all followers.
    vehicle
        Their geometry.
    period
        Sample period [s].

    Raises
    ------
    InputError
        The controller cannot be loaded, does not serve this vehicle, or a gain is wrong.
    """

    def __init__(
        self,
        source: ControllerSource,
        robots: Sequence[str],
        rows: Sequence[int],
        vehicle: fc.CarLike,
        period: float,
    ) -> None:
        self.identity = identify(source)
        self.robots = tuple(robots)
        self.rows = np.asarray(rows)
        self.vehicle = vehicle
        try:
            law = fc.load(source.name)
            gains = _gains(source, law)
            self.controller = law(fc.Team(vehicle, len(robots), period), gains)
        except fc.ControllerError as error:
            raise InputError(f"controller {source.id!r}: {error}", source.where) from None

    def step(
        self, time: float, pose: NDArray[np.float64], leader: fc.Leader, desired: fc.Desired, *, first: bool
    ) -> NDArray[np.float64]:
        """Return the commanded torques (n, 2) [N.m] of this team's followers.

        Raises
        ------
        SimulationError
            The controller refused its input, failed, or returned a torque that is not finite.
        """
        own = fc.Desired(desired.q[self.rows], desired.q_dot[self.rows], desired.q_ddot[self.rows])
        try:
            if first:
                self.controller.start(pose[self.rows], leader, own)
            torque = self.controller.step(pose[self.rows], leader, own)
        except fc.ControllerError as error:
            raise self._failure(error.robot, time, str(error)) from None
        except Exception as error:  # a controller is other people's code: whatever it raises ends this run only
            raise self._failure(None, time, f"{type(error).__name__}: {error}") from error
        finite = np.isfinite(torque).all(axis=1)
        if not finite.all():
            row = int(np.argmin(finite))
            raise self._failure(row, time, f"the torque is {torque[row].tolist()}")
        return torque

    def _failure(self, row: int | None, time: float, message: str) -> SimulationError:
        robot = self.robots[row] if row is not None else " and ".join(self.robots)
        return SimulationError(robot, time, f"the controller {self.identity.name!r} failed: {message}")


def _gains(source: ControllerSource, law: Any) -> Any:
    values = {}
    for setting in source.gains:
        numbers = [float(number) for number in setting.value.split()]
        values[setting.name] = numbers[0] if len(numbers) == 1 else tuple(numbers)
        try:  # one by one, so that the error names the line of the gain that is wrong
            law.gains_type.from_mapping({setting.name: values[setting.name]})
        except fc.GainError as error:
            raise InputError(f"controller {source.id!r}: {error}", setting.where) from None
    return law.gains_type.from_mapping(values)
