"""A control law as a scenario asks for it, as plain data: of an installed class, or of a host's words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeAlias

import formation_controllers as fc
from formation_controllers.controller import Controller
from packaging.specifiers import InvalidSpecifier, SpecifierSet

from cosim.control.environment import environment_at
from cosim.control.host import PUBLIC, GainFault, checked_gains, content_of, described, not_imported
from cosim.control.hosts import Host, Hosts
from cosim.control.installed_laws import installed
from cosim.errors import InputError, nearest
from cosim.scenario.scenario import ControllerSource, Setting

Value: TypeAlias = float | tuple[float, ...]
LawGains: TypeAlias = fc.Gains | tuple[tuple[str, Value], ...]
"""Gains that a law accepts: of its class, or by their names if the law is in another environment."""


@dataclass(frozen=True)
class Law:
    """A control law that is there as asked for, with gains that it accepts.

    Attributes
    ----------
    source : ControllerSource
        The controller in the scenario.
    package, version : str
        The distribution that it comes from.
    content : str
        A checksum of the files of its package and of `formation_controllers`.
    interface : str
        The version of the controllers' interface that it speaks.
    vehicles, needs : tuple of str
        The kinds of vehicles that it serves, and what it needs besides poses.
    signals : tuple of formation_controllers.Signal
        Its telemetry.
    gain_facts : dict
        By the name of each gain its ``default`` and the facts of `formation_controllers.GainInfo`.
    gains
        The gains of followers who have none of their own.
    controller_type : type or None
        The class, a `formation_controllers.controller.Controller`; None if it is in another environment.
    host : Host or None
        That of its environment.
    """

    source: ControllerSource
    package: str
    version: str
    content: str
    interface: str
    vehicles: tuple[str, ...]
    needs: tuple[str, ...]
    signals: tuple[fc.Signal, ...]
    gain_facts: Mapping[str, Mapping[str, Any]]
    gains: LawGains
    controller_type: type[Controller[Any]] | None = None
    host: Host | None = None

    @property
    def environment(self) -> Mapping[str, str]:
        """The versions of another environment, ``python`` among them; empty if it has none."""
        return {} if self.host is None else self.host.versions


def find_law(source: ControllerSource, hosts: Hosts | None = None) -> Law:
    """Find the law that a scenario asks for, and check its gains.

    Parameters
    ----------
    source
        The controller in the scenario.
    hosts
        Those of other environments, if it may have one.

    Raises
    ------
    InputError
        It is not installed, comes from another package or in a version that will not do, cannot be loaded, or a gain
        is wrong; or its environment is none that will do.
    """
    try:
        if source.environment is None:
            return _here(source)
        if hosts is None:
            raise InputError(f"the controller {source.id!r} has an environment of its own, which is of no use here")
        return _elsewhere(source, hosts.of(environment_at(source.environment)))
    except InputError as error:
        raise error if error.where is not None else InputError(error.message, source.where) from None


def gains_of(law: Law, own: Sequence[Setting]) -> LawGains:
    """Return the gains of a follower with some of its own.

    Raises
    ------
    InputError
        A gain is wrong, with its place.
    """
    if not own:
        return law.gains
    names = {setting.name for setting in own}
    common = [setting for setting in law.source.gains if setting.name not in names]
    if law.host is not None:
        return _gains_elsewhere(law.source, law.host, [*common, *own])
    assert law.controller_type is not None
    return _gains(law.source.id, law.controller_type, [*common, *own])


# Laws of this environment -------------------------------------------------------------------------------------------


def _here(source: ControllerSource) -> Law:
    try:
        found = installed(source.name)
        _check_package(source, found.package, found.version, "is installed")
    except fc.ControllerError as error:
        raise InputError(str(error)) from None
    try:
        law = found.load()
    except fc.ControllerError as error:
        raise InputError(not_imported(error, found.entry_point.module)) from None
    gains = _gains(source.id, law, source.gains)
    content = content_here(found)
    return Law(source, found.package, found.version, content, **_stated(law), gains=gains, controller_type=law)


def content_here(found: fc.Installed) -> str:
    """Return the checksum of the files of an installed law; see `Law`."""
    return content_of(found.entry_point.module, PUBLIC)


@lru_cache(maxsize=64)
def _stated(law: type[Controller[Any]]) -> dict[str, Any]:
    about = described(law)
    return {
        "interface": about["interface"],
        "vehicles": tuple(about["vehicles"]),
        "needs": tuple(about["needs"]),
        "signals": law.signals,
        "gain_facts": about["gain_facts"],
    }


def _gains(controller: str, law: type[Controller[Any]], settings: Sequence[Setting]) -> fc.Gains:
    try:
        gains: fc.Gains = checked_gains(law, [(setting.name, _value(setting)) for setting in settings])
    except GainFault as error:
        where = settings[error.place].where if error.place >= 0 else None
        raise InputError(f"controller {controller!r}: {error}", where) from None
    return gains


# Laws of other environments -----------------------------------------------------------------------------------------


def _elsewhere(source: ControllerSource, host: Host) -> Law:
    about = host.described(source.name)
    if "known" in about:
        raise InputError(
            f"no package in {host.shown} offers a controller {source.name!r}: {nearest(source.name, about['known'])}"
        )
    package, version = about["package"], about["version"]
    _check_package(source, package, version, f"is installed in {host.shown}")
    if "fault" in about:
        raise InputError(f"{about['fault']}, in {host.shown}")
    gains = _gains_elsewhere(source, host, source.gains)
    return Law(source, **about, gains=gains, host=host)


def _gains_elsewhere(source: ControllerSource, host: Host, settings: Sequence[Setting]) -> LawGains:
    try:
        return host.gains(source.name, [(setting.name, _value(setting)) for setting in settings])
    except GainFault as error:
        where = settings[error.place].where if 0 <= error.place < len(settings) else None
        raise InputError(f"controller {source.id!r}: {error}", where) from None


# Both ---------------------------------------------------------------------------------------------------------------


def _value(setting: Setting) -> Value:
    numbers = tuple(float(number) for number in setting.value.split())
    return numbers[0] if len(numbers) == 1 else numbers


def _check_package(source: ControllerSource, package: str, version: str, there: str) -> None:
    if source.package != package:
        raise InputError(
            f"the controller {source.name!r} {there} from the package {package}, not from {source.package}"
        )
    try:
        wanted = SpecifierSet(source.version)
    except InvalidSpecifier:
        raise InputError(f'version="{source.version}" is no version range, such as "~=0.1.0"') from None
    if not wanted.contains(version, prereleases=True):
        raise InputError(
            f"the controller {source.name!r} needs {source.package} {source.version}, but version {version} {there}"
        )
