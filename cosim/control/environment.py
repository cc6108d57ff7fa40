"""Python environments in which control laws run: where their interpreter is."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path

from cosim.errors import InputError
from cosim.missing_file import absent

REMEDY = '"formation env create FOLDER PACKAGE==VERSION" makes one'


@dataclass(frozen=True)
class Environment:
    """A Python environment.

    Attributes
    ----------
    folder : Path
        Its folder, as the scenario names it.
    interpreter : Path
        Its Python.
    """

    folder: Path
    interpreter: Path


def environment_at(folder: Path) -> Environment:
    """Return the environment in a folder, whose Python need not work.

    Raises
    ------
    InputError
        There is no such folder, or no Python in it.
    """
    if not os.path.isdir(folder):
        if os.path.exists(folder):
            raise InputError(f"the environment {folder} is a file: name the folder of a virtual environment; {REMEDY}")
        raise InputError(f"there is no environment {folder}: {absent(folder).replace('file', 'folder')}; {REMEDY}")
    interpreter = interpreter_in(folder)
    if not os.path.lexists(interpreter):
        raise InputError(f"{folder} is no virtual environment: it has no {interpreter.relative_to(folder)}; {REMEDY}")
    if not os.path.exists(interpreter):
        raise InputError(
            f"the environment {folder} is broken: its {interpreter.relative_to(folder)} leads to "
            f"{os.path.realpath(interpreter)}, which is not there (any more); {REMEDY}"
        )
    return Environment(folder, interpreter)


def interpreter_in(folder: Path) -> Path:
    """Return where a virtual environment has its Python."""
    return folder / "Scripts" / "python.exe" if sys.platform == "win32" else folder / "bin" / "python"
