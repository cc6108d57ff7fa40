"""What the code of a function depends on: the sources of its module and of the modules that this one imports."""

from __future__ import annotations

import ast
import hashlib
import os
import sys
import sysconfig
import warnings
from collections.abc import Iterator
from functools import cache
from importlib.util import resolve_name
from pathlib import Path

_OURS = ("cosim", "formation_controllers", "plants")
_STANDARD = tuple({os.path.join(sysconfig.get_path(name), "") for name in ("stdlib", "platstdlib")})


def sources_of(module: str) -> str:
    """Return a checksum of the sources of a module and of all that it imports by statements, one through the other.

    Of installed packages, but for the module's own, the file that is imported is known by its time and size alone:
    a newer version is another file. The standard library belongs to Python, and our own packages have versions.

    Parameters
    ----------
    module
        The name of a module that is imported.
    """
    found, names = dict[str, str](), [module]
    while names:
        name = names.pop()
        file = _file(name)
        if file is None or file in found:
            continue
        if _installed(file) and name.partition(".")[0] != module.partition(".")[0]:
            found[file] = _version(file)
        else:
            package = getattr(sys.modules[name], "__package__", None) or ""
            found[file], imported = _read(file, package, _version(file))
            names += imported
    return hashlib.sha256(" ".join(found[file] for file in sorted(found)).encode()).hexdigest()


def _file(name: str) -> str | None:
    """Return the file of a module that is imported; None if it has none, or belongs to Python or to us."""
    if name.partition(".")[0] in _OURS:
        return None
    file = getattr(sys.modules.get(name), "__file__", None)
    if not isinstance(file, str) or (file.startswith(_STANDARD) and not _installed(file)):
        return None
    return file


def _installed(file: str) -> bool:
    return any(part in ("site-packages", "dist-packages") for part in Path(file).parts)


def _version(file: str) -> str:
    try:
        stat = os.stat(file)
    except OSError:  # of an archive, say
        return ""
    return f"{stat.st_mtime_ns} {stat.st_size}"


@cache
def _read(file: str, package: str, version: str) -> tuple[str, tuple[str, ...]]:
    """Return the checksum of a source and the names of what it imports, some of which are no modules."""
    try:
        content = Path(file).read_bytes()
        with warnings.catch_warnings():  # of a user's text, who has seen them at the import
            warnings.simplefilter("ignore")
            text = ast.parse(content)
    except (OSError, SyntaxError, ValueError, RecursionError):  # no text of Python: a module in another language, say
        return version, ()
    return hashlib.sha256(content).hexdigest(), tuple(_imported(text, package))


def _imported(text: ast.Module, package: str) -> Iterator[str]:
    for node in ast.walk(text):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                try:
                    base = resolve_name("." * node.level + base, package)
                except ImportError:
                    continue
            names = [base, *(f"{base}.{alias.name}" for alias in node.names)]
        else:
            continue
        for name in names:
            parts = name.split(".")
            yield from (".".join(parts[:end]) for end in range(1, len(parts) + 1))
