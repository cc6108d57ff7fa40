"""Whether an FMU is clearly no vehicle of a kind: by what it has, never by names that tell nothing."""

from __future__ import annotations

from collections.abc import Collection

from cosim.fmu.model_description import ModelDescription
from cosim.fmu.units import unit_name, unit_of
from cosim.swap.candidates import Number, Numbers
from cosim.swap.naming import words_of
from cosim.vehicle.contract import CAR_LIKE, TRACTOR_TRAILER, Contract
from plants import UnitError, units

_SIDES = {"right": "right", "r": "right", "left": "left", "l": "left"}
_STEERING = frozenset(("steer", "steering", "gamma", "delta"))
_TRAILING = frozenset(
    ("trailer", "semitrailer", "hitch", "tractor", "truck", "drawbar", "articulation", "articulated", "tow", "towing")
)
_NO_DRIVE = frozenset(
    ("d", "dist", "disturbance", "wind", "load", "friction", "resistance", "slip", "brake", "braking", "light")
)
"""Words of inputs that neither drive nor steer."""
_TORQUES = 2
"""How many a vehicle has."""


def no_vehicle(description: ModelDescription, numbers: Numbers) -> str:
    """Return why an FMU is no vehicle of any kind: it lacks inputs that could be torques; empty if it may be one."""
    found = [repr(number.name) for number in numbers.of("input") if _may_be_a_torque(description, number)]
    if len(found) >= _TORQUES:
        return ""
    return (
        f"it has {f'only {found[0]}' if found else 'no input'} that could be a torque, in N.m, N, a pure number or "
        "without a unit; two are needed"
    )


def other_kind(contract: Contract, numbers: Numbers, missing: Collection[str], said: str) -> str:
    """Return why an FMU is clearly another kind of vehicle than a contract's; empty if it is not.

    Parameters
    ----------
    contract
        The contract.
    numbers
        The FMU's numbers.
    missing
        The roles for which there is nothing.
    said
        What the FMU says of itself as a whole.
    """
    inputs = [number for number in numbers.of("input") if not _NO_DRIVE & set(number.words)]
    steering = [number.name for number in inputs if _STEERING & set(number.words)]
    wheels = _wheels([number for number in inputs if not _STEERING & set(number.words)])
    if wheels and not steering:
        drives = f"its inputs {wheels[0]!r} and {wheels[1]!r} are for a right and a left wheel"
        if contract is CAR_LIKE:
            return f"{drives}, and no input steers"
        trailing = _TRAILING & set(words_of(said)) or numbers.having(_TRAILING)
        if contract is TRACTOR_TRAILER and not trailing and {"theta_0", "theta_1"} & set(missing):
            return f"{drives}, and nothing speaks of a trailer or a hitch: it seems to be a differential-drive robot"
    if contract is TRACTOR_TRAILER and steering and not wheels:
        return f"its input {steering[0]!r} steers, and no two inputs are for a right and a left wheel"
    return ""


def _wheels(inputs: list[Number]) -> tuple[str, str] | None:
    """Return two inputs whose names differ by right and left only."""
    found: dict[tuple[str, ...], dict[str, str]] = {}
    for number in inputs:
        sides = {_SIDES[word] for word in number.words if word in _SIDES}
        if len(sides) == 1:
            rest = tuple(word for word in number.words if word not in _SIDES)
            found.setdefault(rest, {})[sides.pop()] = number.name
    return next(((pair["right"], pair["left"]) for pair in found.values() if len(pair) == 2), None)


def _may_be_a_torque(description: ModelDescription, number: Number) -> bool:
    """Return whether a number is a torque, a force or a pure number by its unit, or in no unit that is known."""
    if not unit_name(number.variable):
        return not number.hint or _of_a_torque(units.parse(number.hint))
    try:
        return _of_a_torque(unit_of(description, number.variable))
    except UnitError:
        return True


def _of_a_torque(own: units.Unit) -> bool:
    return any(own.exponents == units.parse(unit).exponents for unit in ("N.m", "N", "1"))
