"""The teams of a scenario as FMUs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import plants
from cosim.errors import InputError
from cosim.master.setup import Setup
from cosim.scenario.scenario import Scenario
from cosim.team_fmu import team_model


@dataclass(frozen=True)
class TeamFmu:
    """The FMU of a team: sensors, control law and actuators of its followers.

    Attributes
    ----------
    name : str
        The id of the controller.
    path : Path
        The FMU.
    robots : tuple of str
        The followers.
    """

    name: str
    path: Path
    robots: tuple[str, ...]


def team_fmus(scenario: Scenario, setup: Setup, *, late: bool) -> tuple[TeamFmu, ...]:
    """Build the FMU of each controller that serves a follower.

    Parameters
    ----------
    scenario, setup
        The scenario with its set-up.
    late
        Whether the FMUs give their commands one communication step late.

    Raises
    ------
    InputError
        A law cannot become an FMU, or none can be built.
    """
    robots: dict[str, list[str]] = {}
    for follower in scenario.followers:
        robots.setdefault(follower.controller, []).append(follower.id)
    try:
        return tuple(
            TeamFmu(name, plants.build(replace(team_model(scenario, setup, name), late=late)), tuple(own))
            for name, own in robots.items()
        )
    except plants.PlantError as error:
        raise InputError(str(error)) from None
