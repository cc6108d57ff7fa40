"""``formation import``: a scenario from an SSP."""

from __future__ import annotations

import argparse
import os
import shlex

from cosim.cli.console import out, safe, taking_a_while, warn
from cosim.errors import InputError, OutputError
from cosim.results.files import write
from cosim.ssp.imported import import_ssp


def import_system(options: argparse.Namespace) -> int:
    """Write the scenario of an SSP and its files; print what is left to do."""
    with taking_a_while(f"reading {options.ssp}"):
        imported = import_ssp(options.ssp, options.out)
    if not options.force:
        for path in imported.files:
            if os.path.exists(path):
                raise InputError(f"{path} exists: --force overwrites it, --out names another file")
    for path, content in imported.files.items():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"the folder {path.parent} cannot be made: {error.strerror}") from None
        write(path, content)
        out().print(f"wrote {safe(str(path))}", soft_wrap=True)
    for note in imported.notes:
        warn(note)
    if imported.to_do:
        out().print("[bold]to do[/], also as comments in the scenario:", soft_wrap=True)
        for sentence in imported.to_do:
            out().print(f"  {safe(sentence)}", soft_wrap=True)
    verb = "run" if imported.runs else "check"
    command = f"formation {verb} {shlex.quote(str(imported.scenario))}"
    out().print(f"next: {safe(command)}", soft_wrap=True)
    return 0
