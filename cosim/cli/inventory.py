"""``formation list``: what there is to run."""

from __future__ import annotations

import argparse
from pathlib import Path

import formation_controllers
from rich.markup import escape

import plants
from cosim.cli.console import out, table
from cosim.errors import InputError
from cosim.grammar import schema_path
from cosim.reader import read_scenario
from cosim.swap import BINDING_SUFFIX

_FOLDER = Path("scenarios")


def inventory(_: argparse.Namespace) -> int:
    """Print built-in plants, installed controllers, the scenarios in ./scenarios and where their schema is."""
    console = out()
    listed = table(console, "Plants")
    listed.add_column("model")
    listed.add_column("what it is")
    for name, description in plants.models().items():
        listed.add_row(name, description)
    console.print(listed)

    listed = table(console, "Controllers")
    for heading in ("name", "package", "version"):
        listed.add_column(heading)
    for name, found in sorted(formation_controllers.installed().items()):
        listed.add_row(name, found.package, found.version)
    console.print(listed)

    listed = table(console, f"Scenarios in {_FOLDER}/")
    listed.add_column("file", no_wrap=True)
    listed.add_column("title")
    for path in sorted(_FOLDER.glob("*.xml")):
        if path.name.endswith(BINDING_SUFFIX):
            continue
        try:
            title = read_scenario(path).title
        except InputError as error:
            title = f"not a scenario: {error.message}"
        listed.add_row(escape(str(path)), escape(title))
    console.print(listed)
    console.print(f"Schema of scenarios, for an editor: {schema_path()}", markup=False, highlight=False, soft_wrap=True)
    return 0
