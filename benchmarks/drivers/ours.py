"""Our master: plants and fleet of `cosim`, without what else a simulation does.

With the option `by_tick`, `run` calls the master once a tick from Python, as a closed loop must.
"""

from pathlib import Path

import numpy as np
from cosim.fleet import Fleet
from serve import OUTPUTS, Floats, Job, Master, serve

from cosim.fmu import open_fmu
from cosim.plant import Plant


def make_fleet(job: Job) -> Fleet:
    """Return the robots of a job."""
    fmu = open_fmu(Path(job.fmu))
    poses = [[start.get(name, 0.0) for name in OUTPUTS[:4]] for start in job.start]
    return Fleet([Plant(fmu, f"robot_{i}", (), pose, 1e9) for i, pose in enumerate(poses)])


def advance(fleet: Fleet, first: int, step: float, given: Floats, out: Floats) -> None:
    """Run many ticks: hold given[k] in tick first + k, and write the outputs after it into out[k]."""
    for k in range(len(out)):
        fleet.step((first + k) * step, step, given[k])
        fleet.read((first + k + 1) * step, out[k])


class Ours:
    def __init__(self, job: Job) -> None:
        self.step = job.step
        self.fleet = make_fleet(job)
        self.by_tick = job.options.get("by_tick", False)
        self.now = 0
        self.given = np.tile(np.ravel(job.torque), (job.samples, 1))
        self.out = np.full((job.samples, len(job.start), len(OUTPUTS)), np.nan)

    def run(self, ticks: int) -> None:
        assert ticks <= len(self.out)
        at_once = 1 if self.by_tick else ticks
        for first in range(0, ticks, at_once):
            some = slice(first, first + at_once)
            advance(self.fleet, self.now, self.step, self.given[some], self.out[some])
            self.now += at_once

    def tick(self, torque: Floats) -> Floats:
        advance(self.fleet, self.now, self.step, torque.reshape(1, -1), self.out[:1])
        self.now += 1
        return self.out[0]

    def outputs(self) -> Floats:
        out = np.empty(self.out.shape[1:])
        self.fleet.read(self.now * self.step, out)
        return out

    def recorded(self, ticks: int) -> Floats:
        return self.out[:ticks]


def start(job: Job) -> Master:
    return Ours(job)


if __name__ == "__main__":
    serve(start)
