"""Gains: frozen dataclasses whose fields know their symbol, unit and bounds."""

from __future__ import annotations

import math
import numbers
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from formation_controllers.errors import GainError, unknown


@dataclass(frozen=True)
class GainInfo:
    """The statements about one gain.

    Attributes
    ----------
    symbol : str
        The symbol in the paper.
    unit : str
        Unit of the range's component; the bearing's has rad for m and N.m for N.
    description : str
        Its effect.
    size : int or None
        1: a number; 2: a diagonal matrix, given as a number or as a pair (range, bearing); None: any length.
    above, at_least : float or None
        Lower bound, excluded or included.
    below : float or None
        Upper bound, excluded.
    finite : bool
        Whether infinity is refused.
    reason : str
        Why the bound is there.
    """

    symbol: str
    unit: str
    description: str
    size: int | None = 1
    above: float | None = None
    at_least: float | None = None
    below: float | None = None
    finite: bool = True
    reason: str = ""


def gain(default: float | tuple[float, ...], symbol: str, unit: str, description: str, **rest: Any) -> Any:
    """State one gain: a dataclass field with a `GainInfo` as its metadata under the key ``"gain"``."""
    return field(default=default, metadata={"gain": GainInfo(symbol, unit, description, **rest)})


def gain_info(gains_type: type[Gains]) -> dict[str, GainInfo]:
    """Return name and `GainInfo` of every gain of a gains class, in the order they are stated."""
    return {f.name: f.metadata["gain"] for f in fields(gains_type)}


@dataclass(frozen=True)
class Gains:
    """Base of all gains; checks every field when made.

    Numbers become floats; diagonal matrices and vectors become tuples of floats. A sequence of length 1
    counts as a number, and a number given for a diagonal matrix as both of its entries.

    Raises
    ------
    GainError
        If a value is no number, is not finite, has the wrong length or breaks a bound.
    """

    def __post_init__(self) -> None:
        for name, info in gain_info(type(self)).items():
            object.__setattr__(self, name, _checked(name, getattr(self, name), info))

    @classmethod
    def from_mapping(cls, values: Mapping[str, float | Sequence[float]]) -> Self:
        """Make gains from names and values; gains not named keep their default.

        Raises
        ------
        GainError
            If a name is not a gain of this class, or a value is refused.
        """
        for name in values:
            if name not in gain_info(cls):
                raise GainError(unknown("gain", name, gain_info(cls)))
        return cls(**values)


def gain_records(gains: Sequence[Gains]) -> NDArray[np.void]:
    """Lay out gains as a structured array, one record a robot, for compiled code.

    Raises
    ------
    GainError
        If a vector of gains has another length for one robot than for the first.
    """
    names = tuple(gain_info(type(gains[0])))
    layout = [(name, float, np.shape(getattr(gains[0], name))) for name in names]
    for robot, own in enumerate(gains):
        for name, _, shape in layout:
            if np.shape(getattr(own, name)) != shape:
                raise GainError(
                    f"gain {name!r} has {np.size(getattr(own, name))} entries: expected {shape[0]}, as robot 0 has",
                    robot=robot,
                )
    values = [tuple(getattr(own, name) for name in names) for own in gains]
    return np.array(values, dtype=np.dtype(layout))


def _checked(name: str, value: object, info: GainInfo) -> float | tuple[float, ...]:
    """Return a gain in its normal form, or refuse it."""
    given = value.tolist() if isinstance(value, np.ndarray) else value
    entries = (
        tuple(given) if isinstance(given, Sequence) and not isinstance(given, str | bytes | bytearray) else (given,)
    )
    allowed = {1: "one number", 2: "one number or a pair (range, bearing)", None: "one or more numbers"}[info.size]
    real = all(isinstance(entry, numbers.Real) and not isinstance(entry, bool) for entry in entries)
    if not entries or not real or (info.size and len(entries) not in (1, info.size)):
        raise GainError(f"gain {name!r} is {value!r}: expected {allowed}")
    try:
        values = tuple(float(entry) for entry in entries)
    except OverflowError:
        raise GainError(f"gain {name!r} is beyond the largest number of double precision") from None
    for number in values:
        if math.isnan(number) or (info.finite and math.isinf(number)):
            raise GainError(f"gain {name!r} is {number}: expected a {'finite ' * info.finite}number")
        because = f" ({info.reason})" if info.reason else ""
        if info.above is not None and not number > info.above:
            raise GainError(f"gain {name!r} is {number:g}: must be greater than {info.above:g}{because}")
        if info.below is not None and not number < info.below:
            raise GainError(f"gain {name!r} is {number:g}: must be less than {info.below:g}{because}")
        if info.at_least is not None and not number >= info.at_least:
            raise GainError(f"gain {name!r} is {number:g}: must be at least {info.at_least:g}{because}")
    if info.size == 1:
        return values[0]
    return values * 2 if info.size == 2 and len(values) == 1 else values
