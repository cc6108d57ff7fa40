"""The leader as a team sees it, in C: as it is, or as a vehicle of the followers' kind on the same path."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields
from typing import Any, cast

import numpy as np
from formation_controllers.vehicles import Vehicle

from cosim.control.team import Team
from cosim.team_fmu.c_text import number
from cosim.translation import CSource, Entry
from cosim.translation.names import identifier
from cosim.vehicle.path import Course
from plants import elementary


class LeaderInC:
    """The inputs of a team that belong to the leader.

    Attributes
    ----------
    entries : tuple of Entry
        The functions that find the leader's place on its path, and the state of a follower's kind of vehicle there.
    """

    primitives: Sequence[Callable[..., Any]] = elementary.PRIMITIVES

    def __init__(self, label: str, team: Team) -> None:
        self._label, self._team = label, team
        self.entries: tuple[Entry, ...] = ()
        self._is_alike = team.alike
        if self._is_alike:
            return
        on_path, leads_on = team.view.on_paths
        self._leader, self._vehicle = _numbers("Leader", team.leader), _numbers("Follower", team.vehicle)
        state = np.zeros(len(team.leader.pose) + len(team.leader.velocity))
        self.entries = (
            Entry(f"course_{label}", leads_on.course, (self._leader, state)),
            Entry(f"seen_{label}", on_path.state, (self._vehicle, Course(*[0.0] * len(Course._fields)))),
        )

    def lines(
        self, source: CSource, taken: str, measured: str, velocities: Sequence[str], accelerations: Sequence[str]
    ) -> Iterator[str]:
        """Yield the statements that fill in the leader of the inputs `taken`."""
        poses = [f"{measured}[{column}]" for column in range(len(self._team.leader.pose))]
        if not self._is_alike:
            label = self._label
            given = _type(source, f"course_{label}", "(")
            state = [*poses, *velocities]
            yield f"const double leader_{label}[{len(state)}] = {{{', '.join(state)}}};"
            yield f"const {given} leads_{label} = {_initialiser(self._leader)};"
            yield f"const {_type(source, f'seen_{label}', '(')} follows_{label} = {_initialiser(self._vehicle)};"
            course = source.prototypes[f"course_{label}"].split()[0]
            seen_type = source.prototypes[f"seen_{label}"].split()[0]
            yield f"const {course} course_{label} = team_course_{label}(leads_{label}, leader_{label});"
            yield f"const {seen_type} seen_{label} = team_seen_{label}(follows_{label}, course_{label});"
            entries = len(self._team.vehicle.pose) + len(self._team.vehicle.velocity)
            seen = [f"seen_{label}.item_{place}" for place in range(entries)]
            poses, velocities = seen[: len(self._team.vehicle.pose)], seen[len(self._team.vehicle.pose) :]
            accelerations = ["0.0"] * len(velocities)  # between different vehicles they are left out
        for column, pose in enumerate(poses):
            yield f"{taken}.leader_pose[{column}] = {pose};"
        for column, (velocity, acceleration) in enumerate(zip(velocities, accelerations, strict=True)):
            yield f"{taken}.leader_velocity[{column}] = {velocity};"
            yield f"{taken}.leader_acceleration[{column}] = {acceleration};"


def _numbers(name: str, vehicle: Vehicle) -> Any:
    """Return those facts of a vehicle that are numbers, by the same names."""
    facts = {f.name: getattr(vehicle, f.name) for f in fields(cast(Any, vehicle))}
    own = {key: float(value) for key, value in facts.items() if isinstance(value, float)}
    return namedtuple(name, own)(**own)


def _initialiser(facts: Any) -> str:
    inner = ", ".join(f".{identifier(key)} = {number(value)}" for key, value in facts._asdict().items())
    return f"{{{inner}}}"


def _type(source: CSource, entry: str, before: str) -> str:
    """Return the type of the first argument of a function."""
    return source.prototypes[entry].partition(before)[2].split()[0]
