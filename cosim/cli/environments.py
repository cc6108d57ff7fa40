"""``formation env``: Python environments for controllers."""

from __future__ import annotations

import argparse
from pathlib import Path

from cosim.cli.console import out, safe, say, table, taking_a_while, warn
from cosim.control.environment import environment_at
from cosim.control.hosts import Host
from cosim.control.new_environment import create
from cosim.errors import InputError


def environments(options: argparse.Namespace) -> int:
    """Make an environment, or tell what is in some."""
    folder: Path = options.folder
    if options.action == "create":
        if not options.packages:
            raise InputError("formation env create DIR PACKAGE: name a package with its version, a wheel, or a folder")
        with taking_a_while(f"installing {', '.join(options.packages)} in {folder}"):
            create(folder, options.packages, python=options.python, wheels=options.wheels, share=options.share)
    elif options.packages:
        raise InputError(f'formation env list DIR takes no package: "{options.packages[0]}"')
    elif options.python or options.wheels is not None or options.share:
        raise InputError("formation env list DIR takes none of --python, --wheels and --share: they are of env create")
    _show(folder)
    return 0


def _show(folder: Path) -> None:
    """Print the controllers of an environment."""
    host = Host(environment_at(folder))
    try:
        found = host.installed()
        versions = host.versions
    finally:
        host.stop()
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
