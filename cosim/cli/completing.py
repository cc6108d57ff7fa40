"""``formation completion``: a script that makes a shell complete the command line."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from cosim.cli.console import verbatim
from cosim.errors import InputError

SHELLS = ("bash", "zsh", "tcsh", "fish", "powershell")


def completion(parser: argparse.ArgumentParser, shell: str) -> int:
    """Print the script by which a shell completes commands, options, and names of files by their ending."""
    try:
        import shtab
    except ImportError:
        raise InputError(
            "completion needs the package shtab; install it: python -m pip install 'formation-cosim[completion]'"
        ) from None
    for action in _actions(parser):
        metavar = action.metavar if isinstance(action.metavar, str) else ""
        if metavar == "DIR":
            action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
        elif "." in metavar and "=" not in metavar:  # such as SCENARIO.xml
            action.complete = shtab.glob(f"*.{metavar.rpartition('.')[2]}")  # type: ignore[attr-defined]
    verbatim(str(shtab.complete(parser, shell)))
    return 0


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _actions(command)
