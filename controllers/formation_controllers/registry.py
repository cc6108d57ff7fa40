"""Finding controllers by name: the entry-point group ``formation.controllers`` of the installed packages."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Any, Final

from formation_controllers.errors import ControllerError, IncompatibleInterface, UnknownController, unknown
from formation_controllers.interface import INTERFACE_VERSION

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


def installed() -> dict[str, Installed]:
    """Return all installed controllers by name, without importing them.

    Raises
    ------
    ControllerError
        If two packages bring a controller of the same name.
    """
    found: dict[str, Installed] = {}
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        package, version = (point.dist.name, point.dist.version) if point.dist else ("?", "?")
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
        If it cannot be imported or is no controller.
    """
    known = installed()
    if name not in known:
        raise UnknownController(unknown("controller", name, known))
    which = f"controller {name!r} of {known[name].package} {known[name].version}"
    try:
        loaded = known[name].entry_point.load()
    except Exception as error:  # whatever someone's module does when imported
        raise ControllerError(f"{which} cannot be imported: {error}") from error
    from formation_controllers.controller import Controller

    if not (isinstance(loaded, type) and issubclass(loaded, Controller)):
        raise ControllerError(f"{which} is {loaded!r}: expected a subclass of {Controller.__name__}")
    if not compatible(getattr(loaded, "interface", None)):
        raise IncompatibleInterface(
            f"{which} speaks version {getattr(loaded, 'interface', None)} of the controller interface, and "
            f"version {INTERFACE_VERSION} is spoken here: install releases that agree in the first number"
        )
    return loaded


def compatible(version: object) -> bool:
    """Tell whether a controller that speaks this version of the interface can be used here."""
    match = re.fullmatch(r"(\d+)\.(\d+)", version) if isinstance(version, str) else None
    major, minor = (int(number) for number in INTERFACE_VERSION.split("."))
    return match is not None and int(match[1]) == major and int(match[2]) <= minor
