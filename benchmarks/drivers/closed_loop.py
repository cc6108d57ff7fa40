"""The closed loop of a scenario in Python around any master: noise, controller, saturation, recording.

The leader is robot 0 and is driven by a constant torque. All that depends on the harness comes in numbers, so that this
runs where the harness is not installed.
"""

from typing import Any

import formation_controllers as fc
import numpy as np
from formation_controllers.vehicles import CarLike
from serve import Floats, Master


class ClosedLoop:
    """A team under a master.

    Parameters
    ----------
    master
        All robots.
    given
        ``controller``, ``gains``, ``vehicle`` (its geometry), ``desired`` (range and bearing of each follower),
        ``leader_torque``, ``limit`` [N.m], ``step`` [s], ``noise`` (a file with an array (ticks, robots, 4)).
    """

    def __init__(self, master: Master, given: dict[str, Any]) -> None:
        law = fc.load(given["controller"])
        desired = np.array(given["desired"])
        still = np.zeros_like(desired)
        self.master = master
        self.desired = fc.Desired(desired, still, still)
        self.limit = given["limit"]
        self.noise = np.load(given["noise"])
        team = fc.Team(CarLike(**given["vehicle"]), len(desired), given["step"])
        self.controller = law(team, law.gains_type.from_mapping(given["gains"]))
        self.outputs = master.outputs().copy()
        self.now = 0
        self.torque = np.zeros((1 + len(desired), 2))
        self.torque[0] = given["leader_torque"]
        samples = len(self.noise)
        self.kept = np.full((samples, *self.outputs.shape), np.nan)
        self.kept_measured = np.full((samples, *self.outputs[:, :4].shape), np.nan)
        self.kept_torque = np.full((samples, *self.torque.shape), np.nan)
        self.kept_telemetry = np.zeros((samples, len(desired)), self.controller.telemetry_record.dtype)

    def run(self, ticks: int) -> None:
        """Run as many ticks."""
        for k in range(self.now, self.now + ticks):
            measured = self.outputs[:, :4] + self.noise[k]
            leader = fc.Leader(measured[0], self.outputs[0, 4:])
            if k == 0:
                self.controller.start(measured[1:], leader, self.desired)
            command = self.controller.step(measured[1:], leader, self.desired)
            np.clip(command, -self.limit, self.limit, out=self.torque[1:])
            self.kept[k] = self.outputs
            self.kept_measured[k] = measured
            self.kept_torque[k] = self.torque
            self.kept_telemetry[k] = self.controller.telemetry_record
            self.outputs = self.master.tick(self.torque)
        self.now += ticks

    def recorded(self, ticks: int) -> Floats:
        """Return all outputs recorded so far (ticks, robots, 6)."""
        return self.kept[: self.now]
