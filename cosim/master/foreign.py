"""FMU files do not run in the process that judges and writes, unless the scenario trusts them."""

from __future__ import annotations

import sys
from dataclasses import replace

from cosim.scenario.scenario import PlantSource, Scenario

_SUPERVISES = sys.platform == "linux"
"""Whether a run can go to a supervised process, which is forked, and ended with all that it has started."""


def is_foreign(plant: PlantSource) -> bool:
    """Return whether a plant is an FMU file that is not trusted, and for which nobody has asked for a process."""
    return plant.fmu is not None and not plant.trusted and not plant.isolated


def is_supervised(scenario: Scenario) -> bool:
    """Return whether a whole run of a scenario is supervised, as there are FMU files among its plants."""
    used = {scenario.leader.plant, *(follower.plant for follower in scenario.followers)}
    return _SUPERVISES and any(is_foreign(scenario.plants[name]) for name in used)


def contained(scenario: Scenario) -> Scenario:
    """Return a scenario in which each such plant has a process of its own."""
    if not any(map(is_foreign, scenario.plants.values())):
        return scenario
    plants = {
        name: replace(plant, contained=True) if is_foreign(plant) else plant for name, plant in scenario.plants.items()
    }
    return replace(scenario, plants=plants)


def for_whole_run(scenario: Scenario) -> Scenario:
    """Return a scenario to be set up for a whole run: FMU files have processes of their own where none supervises."""
    return scenario if _SUPERVISES else contained(scenario)
