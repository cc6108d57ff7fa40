"""What a controller is told about the vehicles it serves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Final

from formation_controllers.errors import ControllerError, unknown

DRIVES: Final = ("as_printed", "front_wheel", "rear_wheel")
"""Variants of the third row of the input matrix B1 in (56)."""


@dataclass(frozen=True)
class CarLike:
    """Car-like robot; its pose is (x, y, psi, gamma): rear axle [m], heading [rad], steering angle [rad].

    Parameters
    ----------
    wheelbase
        Distance a between the axles [m].
    drive
        Where the first torque acts, that is the first column of B1 in (56): ``as_printed`` (cos psi, sin psi,
        a sin psi, 0), ``front_wheel`` (cos(psi + gamma), sin(psi + gamma), a sin gamma, 0) or ``rear_wheel``
        (cos psi, sin psi, 0, 0).

    Raises
    ------
    ControllerError
        If the wheelbase is not a positive length or the drive is unknown.
    """

    wheelbase: float
    drive: str = "as_printed"

    kind: ClassVar[str] = "car_like"
    pose_components: ClassVar[tuple[str, ...]] = ("x", "y", "psi", "gamma")

    def __post_init__(self) -> None:
        if not (math.isfinite(self.wheelbase) and self.wheelbase > 0):
            raise ControllerError(f"the wheelbase is {self.wheelbase} m: it must be a positive length")
        if self.drive not in DRIVES:
            raise ControllerError(unknown("drive", self.drive, DRIVES))


Vehicle = CarLike
