"""The leader as a team sees it, in C: as it is, or as a vehicle of the followers' kind on the same path."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from cosim.control.leader_view import alike
from cosim.control.team import Team
from cosim.translation import Entry
from cosim.vehicle.kinds import kind_named
from cosim.vehicle.path import Course
from plants import elementary


class LeaderInC:
    """The inputs of a team that belong to the leader.

    Attributes
    ----------
    entries : tuple of Entry
        Functions to translate.
    """

    primitives: Sequence[Callable[..., Any]] = elementary.PRIMITIVES

    def __init__(self, label: str, team: Team) -> None:
        self._label, self._team = label, team
        self._is_alike = alike(team.vehicle, team.leader)
        self.entries: tuple[Entry, ...] = ()

    def lines(
        self, taken: str, measured: str, velocities: Sequence[str], accelerations: Sequence[str]
    ) -> Iterator[str]:
        """Yield the statements that fill in the leader."""
        for column in range(len(self._team.leader.pose)):
            yield f"{taken}.leader_pose[{column}] = {measured}[{column}];"
        for column, (velocity, acceleration) in enumerate(zip(velocities, accelerations, strict=True)):
            yield f"{taken}.leader_velocity[{column}] = {velocity};"
            yield f"{taken}.leader_acceleration[{column}] = {acceleration};"
