"""The facts about the bicycle that a controller is told. They need no harness."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from formation_controllers.vehicles import Entry, FormationGeometry


@dataclass(frozen=True)
class KinematicBicycle:
    """A bicycle that takes a speed and a steering angle.

    Its pose is that of the rear axle's midpoint. The steering angle is no part of it: the bicycle sees its leader from
    the rear axle, relative to its heading.

    Parameters
    ----------
    wheelbase
        Distance a between the axles [m].
    """

    wheelbase: float

    kind: ClassVar[str] = "kinematic_bicycle"
    pose: ClassVar[tuple[Entry, ...]] = (Entry("x", "m"), Entry("y", "m"), Entry("psi", "rad"))
    velocity: ClassVar[tuple[Entry, ...]] = (Entry("v", "m/s"), Entry("omega", "rad/s"))
    command: ClassVar[tuple[Entry, ...]] = (Entry("v_command", "m/s"), Entry("gamma_command", "rad"))
    geometry: ClassVar[tuple[Entry, ...]] = (Entry("wheelbase", "m"),)

    @property
    def formation(self) -> FormationGeometry:
        """How it sees its leader."""
        return FormationGeometry("none", self.wheelbase)
