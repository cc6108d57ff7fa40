"""Our master: plants and fleet of `cosim`, without the other parts of a simulation.

With the option `by_tick`, `run` calls the master once a tick from Python, as a closed loop must.
"""

from pathlib import Path

import numpy as np
from serve import OUTPUTS, Floats, Job, Master, serve

from cosim.errors import Location
from cosim.fmu.vehicle import open_fmu
from cosim.master.robot_plants import plant
from cosim.plant.fleet import Fleet
from cosim.scenario.scenario import PlantSource


class Ours:
    def __init__(self, job: Job) -> None:
        fmu = open_fmu(Path(job.fmu))
        source = PlantSource("plant", Location(job.fmu), fmu=Path(job.fmu))
        poses = [[start.get(name, 0.0) for name in OUTPUTS[:4]] for start in job.start]
        members = [
            plant(fmu, source, name=f"robot_{i}", parameters=(), pose=pose, stop_time=1e9)
            for i, pose in enumerate(poses)
        ]
        self.step = job.step
        self.state = np.empty((len(members), len(members[0].outputs)))
        self.fleet = Fleet(members, self.state)
        self.by_tick = job.options.get("by_tick", False)
        self.now = 0
        self.given = np.tile(np.ravel(job.torque), (job.samples, 1))
        self.out = np.full((job.samples, len(job.start), len(OUTPUTS)), np.nan)

    def run(self, ticks: int) -> None:
        assert ticks <= len(self.out)
        if not self.by_tick:
            self.fleet.run(self.now, self.step, self.given[:ticks], self.out[:ticks])
            self.now += ticks
            return
        for k in range(ticks):
            self.fleet.step(self.now, self.step, self.given[k])
            self.out[k] = self.state
            self.now += 1

    def tick(self, torque: Floats) -> Floats:
        self.fleet.step(self.now, self.step, torque.ravel())
        self.now += 1
        return self.state

    def outputs(self) -> Floats:
        return self.state.copy()

    def recorded(self, ticks: int) -> Floats:
        return self.out[:ticks]


def start(job: Job) -> Master:
    return Ours(job)


if __name__ == "__main__":
    serve(start)
