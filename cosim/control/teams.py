"""The teams of a run, some with their laws here and some in hosts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cosim.control.law import Law
from cosim.control.team import Team
from cosim.control.team_elsewhere import TeamElsewhere, begin
from cosim.control.team_here import TeamHere

__all__ = ["begin", "companions", "team_of"]


def team_of(law: Law, *others: Any) -> Team:
    """Return a team, given the arguments of `Team`.

    Raises
    ------
    InputError
        The law refuses the team; of one in another environment `begin` tells that.
    """
    return TeamHere(law, *others) if law.host is None else TeamElsewhere(law, *others)


def companions(teams: Sequence[Team]) -> tuple[int, ...]:
    """Return the numbers of the processes in which the laws run besides this one."""
    hosts = dict.fromkeys(team.host for team in teams if isinstance(team, TeamElsewhere))
    return tuple(host.process.number for host in hosts)
