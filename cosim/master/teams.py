"""Which followers make a team: those with one controller and equal vehicles."""

from __future__ import annotations

from formation_controllers.vehicles import Vehicle

from cosim.control.team import MadeOf
from cosim.master.setup import Setup
from cosim.scenario.scenario import Scenario


def teams_of(scenario: Scenario, setup: Setup) -> list[MadeOf]:
    """Return what each team of a scenario is made of: the arguments of `cosim.control.team.Team`."""
    groups: dict[tuple[str, Vehicle], list[int]] = {}
    for row, (follower, robot) in enumerate(zip(scenario.followers, setup.followers, strict=True)):
        groups.setdefault((follower.controller, robot.vehicle), []).append(row)
    return [
        (
            setup.laws[controller],
            tuple(setup.gains[row] for row in rows),
            tuple(setup.followers[row].name for row in rows),
            tuple(rows),
            vehicle,
            setup.leader.vehicle,
            scenario.step * scenario.period,
        )
        for (controller, vehicle), rows in groups.items()
    ]
