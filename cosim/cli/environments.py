"""``formation env``: Python environments for controllers."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TypeAlias

from cosim.cli.console import out, safe, say, table, taking_a_while, warn
from cosim.cli.options import refuse
from cosim.control.environment import environment_at
from cosim.control.hosts import Host
from cosim.control.new_environment import create
from cosim.errors import InputError

Found: TypeAlias = tuple[Mapping[str, tuple[str, str]], Mapping[str, str]]


def environments(options: argparse.Namespace) -> int:
    """Make an environment, or tell what is in some."""
    folder: Path = options.folder
    if options.action == "create":
        if not options.packages:
            raise InputError("formation env create DIR PACKAGE: name a package with its version, a wheel, or a folder")
        with taking_a_while(f"installing {', '.join(options.packages)} in {folder}"):
            found = create(
                folder,
                options.packages,
                python=options.python,
                wheels=options.wheels,
                share=options.share,
                check=_found_in_new,
            )
    elif options.packages:
        raise InputError(f'formation env list DIR takes no package: "{options.packages[0]}"')
    else:
        refuse(options, ("--python", "--wheels", "--share"), "is of formation env create, not of env list")
        found = _found(folder)
    _show(folder, *found)
    return 0


def _found(folder: Path) -> Found:
    """Return package and version of each controller in an environment by its name, and the versions of libraries."""
    host = Host(environment_at(folder))
    try:
        return host.installed(), host.versions
    finally:
        host.stop()


def _found_in_new(folder: Path) -> Found:
    try:
        return _found(folder)
    except InputError as error:
        raise InputError(
            f"{error.message}; nothing is kept of it: name a package that needs formation-controllers, or "
            "formation-controllers besides, or take that of Formation with --share"
        ) from None


def _show(folder: Path, found: Mapping[str, tuple[str, str]], versions: Mapping[str, str]) -> None:
    """Print the controllers of an environment."""
    console = out()
    if found:
        listed = table(console, safe(f"Controllers in {folder}"))
        for heading in ("name", "package", "version"):
            listed.add_column(heading)
        for name, (package, version) in found.items():
            listed.add_row(safe(name), safe(package), safe(version))
        console.print(listed)
    else:
        warn(f"no package in {folder} brings a controller")
    say(console, safe(", ".join(f"{name} {version}" for name, version in versions.items())))
    if found:
        say(
            console, safe(f'in a scenario: <controller ... environment="{folder}">, relative to the scenario\'s folder')
        )
