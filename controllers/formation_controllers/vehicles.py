"""What a controller is told about the vehicles it serves."""

from __future__ import annotations

import math
import numbers
from dataclasses import dataclass
from typing import ClassVar, Final, TypeAlias

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
        _require_length("wheelbase", self.wheelbase)
        if not (isinstance(self.drive, str) and self.drive in DRIVES):
            raise ControllerError(unknown("drive", self.drive, DRIVES))


@dataclass(frozen=True)
class TractorTrailer:
    """Tractor with a trailer hitched on its axle; its pose is (x, y, theta_1, theta_0).

    That is the midpoint of the trailer's axle [m], the heading of the trailer and the heading of the tractor
    [rad]. The torques are those of the tractor's right and left wheel, the columns of B1 in (57).

    Parameters
    ----------
    hitch_length
        Distance d from the trailer's axle to the tractor's [m].
    wheel_radius
        Radius r of the tractor's wheels [m].
    half_track
        Half the distance 2b between the tractor's wheels [m].

    Raises
    ------
    ControllerError
        If one of them is not a positive length.
    """

    hitch_length: float
    wheel_radius: float
    half_track: float

    kind: ClassVar[str] = "tractor_trailer"
    pose_components: ClassVar[tuple[str, ...]] = ("x", "y", "theta_1", "theta_0")

    def __post_init__(self) -> None:
        _require_length("hitch length", self.hitch_length)
        _require_length("wheel radius", self.wheel_radius)
        _require_length("half track", self.half_track)


Vehicle: TypeAlias = CarLike | TractorTrailer


def is_positive(value: object) -> bool:
    """Tell whether a value is a positive and finite real number."""
    if not isinstance(value, numbers.Real) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(value) and float(value) > 0
    except OverflowError:
        return False


def _require_length(name: str, value: float) -> None:
    if not is_positive(value):
        raise ControllerError(f"the {name} is {value} m: it must be a positive length")
