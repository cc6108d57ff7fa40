"""Python modules of an FMU: in a process of its own it imports them, even if the harness has some of the same name."""

from __future__ import annotations

import pkgutil
import sys
from importlib.machinery import EXTENSION_SUFFIXES, BuiltinImporter, FrozenImporter
from pathlib import Path


def make_room(folder: Path) -> None:
    """Forget the modules of this process that have the name of a module in a folder.

    Code that has imported them keeps them; a new import looks for them anew. Two kinds of modules stay: modules
    within the interpreter, and packages with compiled modules, which cannot be loaded twice.
    """
    for _, name, _ in pkgutil.iter_modules([str(folder)]):
        own = {key: module for key, module in sys.modules.items() if key == name or key.startswith(f"{name}.")}
        files = [str(getattr(module, "__file__", "")) for module in own.values()]
        within = name == "__main__" or BuiltinImporter.find_spec(name) or FrozenImporter.find_spec(name)
        if within or any(file.endswith(tuple(EXTENSION_SUFFIXES)) for file in files):
            continue
        for key in own:
            del sys.modules[key]
