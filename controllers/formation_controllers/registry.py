"""Finding controllers by name: the entry-point group ``formation.controllers`` of the installed packages."""

from __future__ import annotations

import dataclasses
import math
import re
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Any, Final

from formation_controllers.errors import ControllerError, IncompatibleInterface, UnknownController, unknown
from formation_controllers.gains import Gains
from formation_controllers.interface import INTERFACE_VERSION, MEASUREMENTS, Signal

if TYPE_CHECKING:
    from formation_controllers.controller import Controller

GROUP: Final = "formation.controllers"


@dataclass(frozen=True)
class Installed:
    """An installed controller.

    Attributes
    ----------
    name : str
        Its name.
    package, version : str
        The distribution that brings it, and that distribution's version.
    """

    name: str
    package: str
    version: str
    entry_point: EntryPoint

    def load(self) -> type[Controller[Any]]:
        """Import its class.

        Raises
        ------
        IncompatibleInterface
            It speaks another version of the interface.
        ControllerError
            It cannot be imported, is no controller, or its statements are faulty.
        """
        which = f"controller {self.name!r} of {self.package} {self.version}"
        try:
            loaded = self.entry_point.load()
        except Exception as error:  # a foreign module can raise anything when it is imported
            raise ControllerError(f"{which} cannot be imported: {error}") from error
        except SystemExit as error:
            raise ControllerError(f"{which} cannot be imported: SystemExit: {error}") from error
        from formation_controllers.controller import Controller

        if not (isinstance(loaded, type) and issubclass(loaded, Controller)):
            raise ControllerError(f"{which} is {loaded!r}: expected a subclass of {Controller.__name__}")
        if not hasattr(loaded, "interface"):
            raise ControllerError(f"{which} states no interface: expected a version such as {INTERFACE_VERSION!r}")
        fault = interface_fault(loaded.interface)
        if fault:
            raise IncompatibleInterface(f"{which} {fault}")
        fault = statement_fault(loaded)
        if fault:
            raise ControllerError(f"{which} {fault}")
        return loaded


def installed() -> dict[str, Installed]:
    """Return all installed controllers by name, without importing them.

    Raises
    ------
    ControllerError
        If two packages bring a controller of the same name.
    """
    found: dict[str, Installed] = {}
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        told = point.dist.metadata if point.dist else {"Name": "?", "Version": "?"}  # read once: it is a file
        package, version = told["Name"], told["Version"]
        if point.name in found:
            raise ControllerError(
                f"both {found[point.name].package} and {package} bring a controller named {point.name!r}: "
                "uninstall one of them"
            )
        found[point.name] = Installed(point.name, package, version, point)
    return found


def load(name: str) -> type[Controller[Any]]:
    """Import the class of an installed controller.

    Raises
    ------
    UnknownController
        If no installed package brings it.
    IncompatibleInterface
        If it speaks another version of the interface.
    ControllerError
        If it cannot be imported, is no controller, or its statements are faulty.
    """
    known = installed()
    if name not in known:
        raise UnknownController(unknown("controller", name, known))
    return known[name].load()


def statement_fault(law: type[Controller[Any]]) -> str:
    """Return the fault in a class's statements about itself, if there is one."""
    missing = ", ".join(sorted(getattr(law, "__abstractmethods__", ())))
    if missing:
        return f"lacks {missing}: a controller must implement them"
    vehicles = getattr(law, "vehicles", None)
    if not (isinstance(vehicles, tuple) and vehicles and all(isinstance(kind, str) for kind in vehicles)):
        return f"has vehicles = {vehicles!r}: expected a tuple of kinds, such as ('car_like',)"
    gains_type = getattr(law, "gains_type", None)
    if not (isinstance(gains_type, type) and issubclass(gains_type, Gains)):
        return f"has gains_type = {gains_type!r}: expected a dataclass derived from Gains"
    bare = [field.name for field in dataclasses.fields(gains_type) if "gain" not in field.metadata]
    if bare:
        return f"has a gain {bare[0]!r} that is not stated with gain(...)"
    signals = getattr(law, "signals", None)
    if not (isinstance(signals, tuple) and all(isinstance(signal, Signal) for signal in signals)):
        return f"has signals = {signals!r}: expected a tuple of Signal"
    names = [signal.name for signal in signals]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        return f"has two signals named {twice[0]!r}: their names must differ"
    for signal in signals:
        below = signal.singular_below
        if not (isinstance(below, int | float) and math.isfinite(below) and below >= 0):
            return f"has a signal {signal.name!r} with singular_below = {below!r}: expected a magnitude, 0 or more"
        if below and not signal.singular_at_zero:
            return f"has a signal {signal.name!r} with a singular_below but nothing in singular_at_zero"
    needs = getattr(law, "needs", ())
    if not (isinstance(needs, tuple) and set(needs) <= set(MEASUREMENTS)):
        return f"needs {needs!r}: expected a tuple of {', '.join(MEASUREMENTS)}"
    return ""


def interface_fault(version: object) -> str:
    """Say why a controller that speaks this version of the interface cannot be used here, if it cannot."""
    match = re.fullmatch(r"([0-9]+)\.([0-9]+)", version) if isinstance(version, str) else None
    if match is None:
        return f"states the interface {version!r}, which is not a version: expected one such as {INTERFACE_VERSION!r}"
    major, minor = (int(number) for number in INTERFACE_VERSION.split("."))
    differs = f"speaks version {version} of the controller interface, and version {INTERFACE_VERSION} is spoken here"
    if int(match[1]) != major:
        return f"{differs}: install releases that agree in the first number"
    return f"{differs}: install a newer formation-controllers" if int(match[2]) > minor else ""
