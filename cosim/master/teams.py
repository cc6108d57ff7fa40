"""Which followers make a team: those with one controller, of one kind and equal geometry."""

from __future__ import annotations

from cosim.control.leader_view import LeaderView
from cosim.control.team import MadeOf
from cosim.master.setup import Setup
from cosim.scenario.scenario import Scenario


def teams_of(scenario: Scenario, setup: Setup) -> list[MadeOf]:
    """Return what each team of a scenario is made of: the arguments of `cosim.control.team.Team`."""
    leader = setup.leader
    groups: dict[tuple[str, LeaderView], list[int]] = {}
    for row, (follower, robot) in enumerate(zip(scenario.followers, setup.followers, strict=True)):
        view = LeaderView(robot.kind, robot.vehicle, leader.kind, leader.vehicle)
        groups.setdefault((follower.controller, view), []).append(row)
    return [
        (
            setup.laws[controller],
            tuple(setup.gains[row] for row in rows),
            tuple(setup.followers[row].name for row in rows),
            tuple(rows),
            view,
            scenario.step * scenario.period,
        )
        for (controller, view), rows in groups.items()
    ]
