"""The code that the numbers of a run depend on, by versions and by checksums of files: an edit leaves a version alone.

Another process, maybe of another machine, makes runs with the same code or none.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from importlib.metadata import version

from cosim.control.environment import environment_at
from cosim.control.host import content_of
from cosim.control.hosts import Hosts
from cosim.control.installed_laws import installed
from cosim.control.law import Law, content_here
from cosim.errors import InputError
from cosim.master.setup import Setup
from cosim.scenario.scenario import ControllerSource, Scenario
from cosim.vehicle.kinds import BUILT_IN
from cosim.vehicle.kinds import installed as installed_kinds

FORMATION = "formation-cosim"


class OtherCode(InputError):
    """A process has other code than the one that wants its runs."""


def code_of(setup: Setup) -> dict[str, str]:
    """Return the code of the runs of a set-up scenario: of Formation, of laws, and of kinds of other packages.

    Returns
    -------
    dict
        By what it is, such as a law's name and environment: package, version and checksum.
    """
    found = code_of_vehicles(setup)
    for law in setup.laws.values():
        found[_name(law.source)] = code_of_law(law)
    for other in setup.others.values():
        found |= code_of(other.setup)
    return found


def code_of_vehicles(setup: Setup) -> dict[str, str]:
    """Return the code of Formation, and of the kinds of vehicle that other packages bring; see `code_of`."""
    found = {FORMATION: _told(FORMATION, version(FORMATION), content_of("cosim", "plants", "formation_controllers"))}
    others = {robot.kind.name for robot in (setup.leader, *setup.followers)} - {kind.name for kind in BUILT_IN}
    for kind in installed_kinds() if others else ():
        if kind.name in others:
            found[f"kind {kind.name}"] = _told(kind.package, kind.version, content_of(kind.module))
    return found


def code_of_law(law: Law) -> str:
    """Return package, version and checksum of a law, and the versions of its environment."""
    return _told(law.package, law.version, law.content, law.environment)


def check_code(wanted: Mapping[str, str], own: Mapping[str, str]) -> None:
    """Refuse to make runs with other code than is wanted, as far as that is said; raises OtherCode."""
    for name, its in own.items():
        if wanted.get(name, its) != its:
            raise OtherCode(
                f"the worker on {socket.gethostname()} (process {os.getpid()}) has {its}, where this command has "
                f"{wanted[name]}: its runs could have other numbers; install the same there, or begin again if it was "
                "changed meanwhile"
            )


def check_laws(wanted: Mapping[str, str], scenario: Scenario) -> None:
    """Refuse to say that a scenario cannot be set up if a law is another one than is wanted; raises OtherCode."""
    check_code(wanted, dict(_found(scenario)))


def _found(scenario: Scenario) -> Iterator[tuple[str, str]]:
    with ExitStack() as cleanup:
        hosts = Hosts()
        cleanup.callback(hosts.stop)
        for source in scenario.controllers.values():
            try:
                if source.environment is None:
                    found = installed(source.name)
                    its = _told(found.package, found.version, content_here(found))
                else:
                    host = hosts.of(environment_at(source.environment))
                    about = host.described(source.name)
                    its = _told(about["package"], about["version"], about["content"], host.versions)
            except (InputError, KeyError):
                its = f"no law {source.name!r} that can be loaded"
            yield _name(source), its


def _name(source: ControllerSource) -> str:
    return f"law {source.name}" + (f" of {source.environment}" if source.environment is not None else "")


def _told(package: str, its: str, content: str, environment: Mapping[str, str] | None = None) -> str:
    beside = "".join(f", {name} {own}" for name, own in (environment or {}).items())
    return f"{package} {its} (files {content[:16]}{beside})"
