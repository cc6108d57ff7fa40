"""The FMUs of a scenario's controllers, as files."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path

import plants
from cosim.errors import InputError
from cosim.master.setup import Setup, set_up
from cosim.scenario.scenario import Scenario
from cosim.team_fmu.model import team_model


def team_fmus(
    scenario: Scenario,
    folder: Path,
    *,
    fmi: str = "2.0",
    platforms: str | Iterable[str] | None = None,
    controllers: Iterable[str] = (),
) -> dict[str, Path]:
    """Build the FMU of each controller of a scenario into a folder; return the files by the controllers' ids.

    Parameters
    ----------
    scenario
        The scenario.
    folder
        Where the files go, each named after scenario and controller.
    fmi, platforms
        See `plants.build`.
    controllers
        The ids of some controllers; by default all that serve a follower.

    Raises
    ------
    InputError
        A part of the scenario does not fit, or a law cannot become an FMU; with the place in the scenario or the law.
    """
    with ExitStack() as cleanup:
        setup = set_up(scenario, cleanup, {})
        used = tuple(dict.fromkeys(follower.controller for follower in scenario.followers))
        return {
            controller: build_team_fmu(scenario, setup, controller, folder, fmi=fmi, platforms=platforms)
            for controller in tuple(controllers) or used
        }


def build_team_fmu(
    scenario: Scenario,
    setup: Setup,
    controller: str,
    folder: Path,
    *,
    fmi: str = "2.0",
    platforms: str | Iterable[str] | None = None,
) -> Path:
    """Build the FMU of one controller of a scenario that is set up; return the file. See `team_fmus`."""
    model = team_model(scenario, setup, controller)
    try:
        return plants.build(model, fmi=fmi, platforms=platforms, out=folder)
    except plants.PlantError as error:
        raise InputError(str(error)) from None
