"""``formation list``: plants, controllers and scenarios that are installed."""

from __future__ import annotations

import argparse
from pathlib import Path

import formation_controllers

import plants
from cosim.cli.console import out, safe, table
from cosim.errors import InputError
from cosim.scenario.examples import examples
from cosim.scenario.grammar import schema_path
from cosim.scenario.reader import read_scenario
from cosim.swap.replacement import BINDING_SUFFIX

_FOLDER = Path("scenarios")


def inventory(_: argparse.Namespace) -> int:
    """Print built-in plants, installed controllers, scenarios and where their schema is.

    Lists the scenarios in ./scenarios or, if there are none, the scenarios that come with Formation.
    """
    console = out()
    listed = table(console, "Plants")
    listed.add_column("model")
    listed.add_column("description")
    for name, description in plants.models().items():
        listed.add_row(name, description)
    console.print(listed)

    listed = table(console, "Controllers")
    for heading in ("name", "package", "version"):
        listed.add_column(heading)
    for name, found in sorted(formation_controllers.installed().items()):
        listed.add_row(name, found.package, found.version)
    console.print(listed)

    own = [path for path in sorted(_FOLDER.glob("*.xml")) if not path.name.endswith(BINDING_SUFFIX)]
    where = f"in {_FOLDER}/" if own else "that come with Formation"
    listed = table(console, f"Scenarios {where}")
    listed.add_column("file", no_wrap=True)
    listed.add_column("title")
    for path in own or [path for path in examples() if path.suffix == ".xml"]:
        listed.add_row(safe(str(path) if own else path.name), safe(_title(path)))
    console.print(listed)
    if not own:
        console.print(f'"formation examples" copies them to {_FOLDER}/, "formation new NAME.xml" writes another.')
    console.print(f"Schema of scenarios, for an editor: {schema_path()}", markup=False, highlight=False, soft_wrap=True)
    return 0


def _title(path: Path) -> str:
    try:
        return read_scenario(path).title
    except InputError as error:
        return f"cannot be read as a scenario: {error.message}"
