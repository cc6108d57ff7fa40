"""``formation new`` and ``formation examples``: something to start from."""

from __future__ import annotations

import argparse
import os
import shlex
from pathlib import Path

from cosim.cli.console import out, safe
from cosim.errors import InputError, OutputError
from cosim.results.files import write
from cosim.scenario.examples import examples
from cosim.scenario.first_scenario import MAX_FOLLOWERS, scenario_text
from cosim.scenario.grammar import matches


def new(options: argparse.Namespace) -> int:
    """Write a scenario to start from."""
    path: Path = options.file
    if path.suffix != ".xml":
        raise InputError(f"{path}: name a file that ends in .xml, such as {path.parent / (path.stem or 'mine')}.xml")
    if not matches("name", path.stem) or len(path.stem) > 100:
        raise InputError(
            f"{path}: the file's name becomes the scenario's name: use at most 100 letters, digits, '_', '-' and '.', "
            "a letter or digit first"
        )
    if not 1 <= options.followers <= MAX_FOLLOWERS:
        raise InputError(f"--followers {options.followers}: expected a number from 1 to {MAX_FOLLOWERS}")
    _refuse_to_overwrite([path] if os.path.exists(path) and not options.force else [])
    write(path, scenario_text(path.stem, options.vehicle, options.followers).encode())
    out().print(f"wrote {safe(str(path))}", soft_wrap=True)
    _next(f"formation run {shlex.quote(str(path))}")
    return 0


def copy_examples(options: argparse.Namespace) -> int:
    """Copy the scenarios that come with Formation into a folder, all or none of them."""
    folder: Path = options.folder
    contents = {folder / path.name: path.read_bytes() for path in examples()}
    differ = [path for path, content in contents.items() if os.path.exists(path) and not _holds(path, content)]
    _refuse_to_overwrite(differ if not options.force else [])
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"the folder {folder} cannot be made: {error.strerror}") from None
    for path, content in contents.items():
        write(path, content)
    count = sum(path.suffix == ".xml" for path in contents)
    out().print(f"{count} scenarios in {safe(str(folder))}", soft_wrap=True)
    _next(f"formation run {shlex.quote(str(folder / 'clmr_line.xml'))}")
    return 0


def _holds(path: Path, content: bytes) -> bool:
    try:
        return path.read_bytes() == content
    except OSError:  # a folder, or a file that must not be read
        return False


def _refuse_to_overwrite(paths: list[Path]) -> None:
    if paths:
        others = f", and {len(paths) - 1} others" if len(paths) > 1 else ""
        raise InputError(f"{paths[0]} exists{others}: --force overwrites")


def _next(command: str) -> None:
    out().print(f"next: {safe(command)}", soft_wrap=True)
