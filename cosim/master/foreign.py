"""FMU files do not run in the process that judges and writes, unless the scenario trusts them."""

from __future__ import annotations

from dataclasses import replace

from cosim.scenario.scenario import PlantSource, Scenario


def is_foreign(plant: PlantSource) -> bool:
    """Return whether a plant is an FMU file that is not trusted, and for which nobody has asked for a process."""
    return plant.fmu is not None and not plant.trusted and not plant.isolated


def contained(scenario: Scenario) -> Scenario:
    """Return a scenario in which each such plant has a process of its own."""
    if not any(map(is_foreign, scenario.plants.values())):
        return scenario
    plants = {
        name: replace(plant, contained=True) if is_foreign(plant) else plant for name, plant in scenario.plants.items()
    }
    return replace(scenario, plants=plants)
