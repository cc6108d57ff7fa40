"""Teams of any size from scenarios/clmr_line.xml, and their sensor noise as numbers."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from cosim.master.robot import RobotSetup
from cosim.scenario.scenario import Scenario
from cosim.signals.random import random_stream

SCENARIO = Path(__file__).parents[1] / "scenarios" / "clmr_line.xml"
STEP = 0.02  # communication step of the scenario [s]


def team_scenario(followers: int, ticks: int, folder: Path) -> Path:
    """Return the scenario with as many followers, copies of its own, with its horizon after as many steps."""
    tree = etree.parse(str(SCENARIO))
    root = tree.getroot()
    space = f"{{{root.nsmap[None]}}}"
    root.find(f"{space}simulation").set("horizon", f"{ticks * STEP:.2f} s")
    root.remove(root.find(f"{space}expect"))  # it speaks of times after that
    own = root.findall(f"{space}follower")
    for i in range(len(own), followers):
        copy = etree.fromstring(etree.tostring(own[i % len(own)]))
        copy.set("id", f"follower_{i + 1}")
        root.append(copy)
    for extra in own[followers:]:
        root.remove(extra)
    path = folder / f"clmr_line_{followers}.xml"
    tree.write(str(path), xml_declaration=True, encoding="UTF-8")
    return path


def sensor_noise(scenario: Scenario, robots: Sequence[RobotSetup], samples: int) -> NDArray[np.float64]:
    """Return what the sensors add to the poses (samples, robots, entries): white noise, nothing else."""
    entries = [role.name for role in robots[0].kind.pose]
    noise = np.zeros((samples, len(robots), len(entries)))
    for row, robot in enumerate(robots):
        for effect in robot.sensor:
            assert effect.kind == "noise", f"the sensor of {robot.name} has {effect.text}, too"
            for name in effect.channels:
                drawn = random_stream(scenario.seed, robot.name, f"pose.{name}").standard_normal(samples)
                noise[:, row, entries.index(name)] = drawn * effect.amount
    return noise
