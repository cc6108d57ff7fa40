"""Checks of inputs: arrays of the right shape and of finite numbers, or refused by name."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from formation_controllers.compiled import compiled
from formation_controllers.errors import ControllerError
from formation_controllers.interface import Desired, Floats, Leader
from formation_controllers.vehicles import Vehicle, names

RANGE_BEARING: Final = ("range", "bearing")

_FLOAT = np.dtype(np.float64)


@compiled
def finite(array: Floats) -> bool:
    """Tell whether every number of a C-contiguous array is finite: NumPy's own test costs more than a law."""
    for number in array.ravel():  # noqa: SIM110 (compiled code)
        if not math.isfinite(number):
            return False
    return True


@compiled
def all_finite(a: Floats, b: Floats, c: Floats, d: Floats, e: Floats, f: Floats, g: Floats) -> bool:
    """Tell whether every number of seven C-contiguous arrays is finite."""
    return finite(a) and finite(b) and finite(c) and finite(d) and finite(e) and finite(f) and finite(g)


def fits(value: object, shape: tuple[int, ...]) -> bool:
    """Tell whether a value is an array of floats of this shape, laid out as compiled code expects it."""
    return type(value) is np.ndarray and value.dtype is _FLOAT and value.shape == shape and value.flags.carray


def as_floats(name: str, value: ArrayLike) -> Floats:
    """Return a value as an array of floats of any shape and layout, or refuse it by name."""
    if type(value) is float or (type(value) is np.ndarray and value.dtype is _FLOAT):  # as at almost every tick
        return np.asarray(value)
    if np.ma.is_masked(value) or (isinstance(value, list | tuple) and any(map(np.ma.is_masked, value))):
        raise ControllerError(f"{name} has masked numbers, which no law can use")
    try:
        if not (isinstance(value, np.ndarray) and value.dtype.kind == "f"):
            value = np.asarray(value)
            if value.dtype.kind not in "biufO":  # a complex number, a text, a date
                raise TypeError
            if value.dtype.kind == "O" and any(isinstance(item, str | bytes) for item in value.flat):
                raise TypeError
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ControllerError(f"{name} is not an array of numbers") from None


def converted(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Floats:
    """Return a value as an array that `fits`, or refuse it by name."""
    if fits(value, shape):
        return value  # type: ignore[return-value]
    array = np.asarray(as_floats(name, value), order="C")
    if array.shape != shape:
        raise ControllerError(f"{name} has shape {array.shape}: expected {shape}")
    return array if array.flags.writeable else array.copy()


def checked(name: str, value: ArrayLike, shape: tuple[int, ...], components: tuple[str, ...]) -> Floats:
    """Return a value as an array that `fits`, of finite numbers, or refuse it by name, robot and component."""
    array = converted(name, value, shape)
    if not finite(array):
        index = tuple(np.argwhere(~np.isfinite(array))[0])
        robot = int(index[0]) if array.ndim == 2 else None
        message = f"{name} component {components[index[-1]]} is {array[index]}: expected a finite number"
        raise ControllerError(message, robot=robot)
    return array


def checked_leader(leader: Leader, vehicle: Vehicle) -> Leader:
    """Return a leader whose arrays are `checked`; its pose is read as this vehicle's."""
    if not isinstance(leader, Leader):
        raise ControllerError(f"the leader is a {type(leader).__name__}: expected a Leader, of pose and velocity")
    pose, velocity, acceleration = names(vehicle.pose), names(vehicle.velocity), leader.acceleration
    return Leader(
        checked("the leader's pose", leader.pose, (len(pose),), pose),
        checked("the leader's velocity", leader.velocity, (len(velocity),), velocity),
        None
        if acceleration is None
        else checked("the leader's acceleration", acceleration, (len(velocity),), velocity),
    )


def checked_desired(desired: Desired, size: int) -> Desired:
    """Return desired ranges and bearings of so many followers whose arrays are `checked`."""
    if not isinstance(desired, Desired):
        told = type(desired).__name__
        raise ControllerError(f"the desired place is a {told}: expected a Desired, of q, q_dot and q_ddot")
    return Desired(
        checked("the desired q", desired.q, (size, 2), RANGE_BEARING),
        checked("the desired q_dot", desired.q_dot, (size, 2), RANGE_BEARING),
        checked("the desired q_ddot", desired.q_ddot, (size, 2), RANGE_BEARING),
    )
