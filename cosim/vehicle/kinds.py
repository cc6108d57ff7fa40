"""The kinds of vehicle that are installed: ours, and those of other packages (entry points ``formation.vehicles``).

Ours come first and need no search. A faulty kind of another package is left out; errors that it may have caused
name its fault.
"""

from __future__ import annotations

import copyreg
import numbers
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points

from formation_controllers.vehicles import Vehicle

from cosim.errors import InputError, nearest
from cosim.vehicle.car_like import CAR_LIKE
from cosim.vehicle.differential_drive import DIFFERENTIAL_DRIVE
from cosim.vehicle.kind import Kind, Role
from cosim.vehicle.tractor_trailer import TRACTOR_TRAILER

GROUP = "formation.vehicles"
BUILT_IN = (CAR_LIKE, TRACTOR_TRAILER, DIFFERENTIAL_DRIVE)
"""Our own kinds; pyproject.toml declares them as entry points, too, so that others see them."""

_OURS = "formation-cosim"


@dataclass(frozen=True)
class InstalledKind:
    """A kind of vehicle with the distribution that brings it, and its module there unless it is ours.

    Without the kind, why it cannot be used.
    """

    name: str
    package: str
    version: str
    kind: Kind | None
    fault: str = ""
    module: str = ""


def kinds() -> Iterator[Kind]:
    """Yield all kinds that can be used, ours first; other packages are looked for only when these are used up."""
    yield from BUILT_IN
    yield from (found.kind for found in _others() if found.kind is not None)


def kind_named(name: str) -> Kind:
    """Return a kind.

    Raises
    ------
    InputError
        There is none of this name, or it cannot be used.
    """
    for kind in kinds():
        if kind.name == name:
            return kind
    raise InputError(f"there is no kind of vehicle {name!r}: {nearest(name, [k.name for k in kinds()])}{faults()}")


def _by_name(kind: Kind) -> tuple[Callable[[str], Kind], tuple[str]]:
    return kind_named, (kind.name,)


copyreg.pickle(Kind, _by_name)  # a kind has functions, which do not pickle: its name is sent to another process


def installed() -> tuple[InstalledKind, ...]:
    """Return all kinds, also those that cannot be used, with the package that brings each."""
    from importlib.metadata import version

    ours = (InstalledKind(kind.name, _OURS, version(_OURS), kind) for kind in BUILT_IN)
    return (*ours, *_others())


def faults() -> str:
    """Return the faults of kinds of other packages, to be appended to an error; empty if there are none."""
    return "".join(f"; {found.fault}" for found in _others() if found.fault)


def unit_of_entry(name: str, group: str) -> str | None:
    """Return the unit of an entry of the ``pose`` or the ``command`` of any kind; None if none has it."""
    for kind in kinds():
        roles: tuple[Role, ...] = getattr(kind, group)
        if (unit := next((role.unit for role in roles if role.name == name), None)) is not None:
            return unit
    return None


def entries_of(group: str) -> list[str]:
    """Return the names of the entries of the ``pose`` or the ``command`` of all kinds."""
    return list(dict.fromkeys(role.name for kind in kinds() for role in getattr(kind, group)))


def others() -> tuple[Kind, ...]:
    """Return the kinds that other packages bring."""
    return tuple(found.kind for found in _others() if found.kind is not None)


@cache
def _others() -> tuple[InstalledKind, ...]:
    found: dict[str, InstalledKind] = {}
    brought: dict[str, str] = {kind.name: _OURS for kind in BUILT_IN}
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        told = point.dist.metadata if point.dist else {"Name": "?", "Version": "?"}
        package, version = told["Name"], told["Version"]
        if package == _OURS:
            continue
        if point.name in brought:
            raise InputError(
                f"both {brought[point.name]} and {package} bring a kind of vehicle named {point.name!r}: "
                "uninstall one of them"
            )
        brought[point.name] = package
        which = f"the kind of vehicle {point.name!r} of {package} {version}"
        try:
            loaded = point.load()
            fault = _fault(loaded, point.name, [f.kind for f in found.values() if f.kind is not None])
        except Exception as error:  # a foreign module can raise anything when it is imported
            loaded, fault = None, f"cannot be imported: {type(error).__name__}: {error}"
        sentence = f"{which} {fault}" if fault else ""
        kind = None if fault else loaded
        found[point.name] = InstalledKind(point.name, package, version, kind, sentence, point.module)
    return tuple(found.values())


def _fault(loaded: object, name: str, before: list[Kind]) -> str:
    """Return the fault of the object that an entry point names, as the end of a sentence; empty if there is none."""
    if not isinstance(loaded, Kind):
        return f"is {loaded!r}: expected a cosim.vehicle.kind.Kind"
    if loaded.name != name:
        return f"names itself {loaded.name!r}: expected the name of its entry point"
    if fault := kind_fault(loaded):
        return fault
    for other in (*BUILT_IN, *before):
        for group in ("pose", "command"):
            known: Mapping[str, str] = {role.name: role.unit for role in getattr(other, group)}
            for role in getattr(loaded, group):
                if known.get(role.name, role.unit) != role.unit:
                    return (
                        f"gives {role.name!r} in {role.unit}, but {other.name!r} gives it in {known[role.name]}: "
                        "expected the same unit, or another name"
                    )
    return ""


def kind_fault(kind: Kind) -> str:
    """Return the fault of a kind's statements, as the end of a sentence; empty if there is none."""
    for what, roles, causality in (
        ("pose", kind.pose, "output"),
        ("velocity", kind.velocity, "output"),
        ("command", kind.command, "input"),
    ):
        if not roles:
            return f"has no {what}: expected a tuple of Role"
        for role in roles:
            if role.causality != causality:
                return f"has {role.name!r} in its {what} as {role.causality}: expected {causality}"
    if [role.unit for role in kind.pose[:3]] != ["m", "m", "rad"] or [r.name for r in kind.pose[:2]] != ["x", "y"]:
        return "has another pose than expected: x [m], y [m] and a heading [rad] come first"
    every = [role.name for role in kind.roles]
    if twice := sorted({name for name in every if every.count(name) > 1}):
        return f"has two roles named {twice[0]!r}: expected a name for each"
    if kind.probe and len(kind.probe) != len(kind.pose):
        return f"has a probe of {len(kind.probe)} entries: expected {len(kind.pose)}, as many as the pose has"
    return ""


def vehicle_fault(kind: Kind, vehicle: Vehicle) -> str:
    """Return how a kind and the vehicle that it makes contradict each other, as the end of a sentence; else empty.

    A law reads the entries of a pose and returns commands in the order of its vehicle, the harness in that of the kind.
    """
    for group in ("pose", "velocity", "command"):
        roles: tuple[Role, ...] = getattr(kind, group)
        stated = [(role.name, role.unit) for role in roles]
        entries = getattr(vehicle, group, None)
        try:
            its = [(entry.name, entry.unit) for entry in entries]  # type: ignore[union-attr]
        except (AttributeError, TypeError):
            return f"makes the vehicle {vehicle!r}: expected one whose {group} is a tuple of Entry(name, unit)"
        if its != stated:
            return f"has the {group} {_listed(stated)}, its vehicle {_listed(its)}: expected the same"
    for field, role in kind.geometry.items():  # a result holds them
        value = getattr(vehicle, field, None)
        if value is None or (role.unit and not isinstance(value, numbers.Real)):
            return f"makes a vehicle whose {field} is {value!r}: expected an attribute for each entry of its geometry"
    return ""


def _listed(entries: Sequence[tuple[str, str]]) -> str:
    return ", ".join(f"{name} [{unit}]" for name, unit in entries) or "of no entry"
