"""A robot of a run, ready to be started."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from formation_controllers.vehicles import Vehicle
from numpy.typing import NDArray

from cosim.errors import Location
from cosim.fmu.binding import BoundRole
from cosim.fmu.parameters import ParameterValue
from cosim.fmu.vehicle import Fmu
from cosim.scenario.scenario import PlantSource
from cosim.signals.effects import Effect
from cosim.storage import blocks, is_constant
from cosim.vehicle.kind import Kind
from cosim.vehicle.outline import Outline


@dataclass(frozen=True)
class RobotSetup:
    """One robot, ready to be started.

    Attributes
    ----------
    source : PlantSource
        Its plant in the scenario.
    parameters : tuple of ParameterValue
        The parameters of its plant; its own take their place.
    vehicle : formation_controllers.CarLike or formation_controllers.TractorTrailer
        Its geometry for controllers.
    outline : Outline or None
        Its bodies and wheels; None if its kind states none.
    pose : tuple of float
        Initial pose in the kind's order and units.
    sensor, actuator : tuple of Effect
        Effects between it and the controllers.
    torque : ndarray
        Torques (ticks + 1, 2) [N.m] besides the controller's; a leader has only these.
    inputs : tuple of BoundRole
        Other inputs of the FMU that get values.
    samples : ndarray
        Their values (ticks + 1, inputs) in the roles' units.
    held : tuple of ParameterValue
        Inputs that are no real numbers, at the start.
    changes : dict
        Parameters and inputs of that kind that change, by tick.
    origin : object
        Everything in the scenario from which this follows: robots of equal origins with the same FMU are equal.
    """

    name: str
    where: Location
    fmu: Fmu
    source: PlantSource
    parameters: tuple[ParameterValue, ...]
    vehicle: Vehicle
    outline: Outline | None
    pose: tuple[float, ...]
    sensor: tuple[Effect, ...]
    actuator: tuple[Effect, ...]
    torque: NDArray[np.float64]
    inputs: tuple[BoundRole, ...]
    samples: NDArray[np.float64]
    held: tuple[ParameterValue, ...]
    changes: Mapping[int, tuple[ParameterValue, ...]]
    origin: object = None

    @property
    def kind(self) -> Kind:
        """Its kind of vehicle."""
        return self.fmu.binding.kind

    @property
    def has_torque(self) -> bool:
        """Whether its torque is anything but zero."""
        different = self.torque[: 1 if is_constant(self.torque) else None]
        return any(different[block].any() for block in blocks(len(different), different.shape[1]))
