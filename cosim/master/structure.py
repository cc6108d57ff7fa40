"""The structure of a scenario: what cannot change from run to run of a prepared one, nor in the course of a run."""

from __future__ import annotations

from dataclasses import replace

from cosim.errors import Location
from cosim.scenario.scenario import LEADER, PlantSource, Scenario


def structure(scenario: Scenario) -> dict[str, object]:
    """Return what all runs of a scenario share, by its name."""
    plants = scenario.plants
    return {
        "the step": scenario.step,
        "the sample period": scenario.period,
        "the horizon": scenario.ticks,
        "whether the leader's motion is given": scenario.leader.trajectory is not None,
        "the list of followers": [follower.id for follower in scenario.followers],
        "the list of plants": list(plants),
        **{f"the plant {name!r}": _without_values(plant) for name, plant in plants.items()},
        f"the plant of {LEADER}": scenario.leader.plant,
        **{f"the plant of {follower.id}": follower.plant for follower in scenario.followers},
    }


def _without_values(plant: PlantSource) -> PlantSource:
    return replace(plant, parameters=(), where=Location(""))
