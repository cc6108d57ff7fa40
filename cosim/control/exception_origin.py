"""The message of an exception in other people's code, with its place in that code."""

from __future__ import annotations

import inspect
import traceback
from collections.abc import Collection
from contextlib import suppress

_PUBLIC = "formation_controllers"


def told(error: BaseException, law: type) -> str:
    """Return an exception of a control law in words: its type, its message, and the line of the law.

    Parameters
    ----------
    error
        The exception, with its traceback.
    law
        The class of the controller.
    """
    packages = {_package(base.__module__) for base in law.__mro__} - {_PUBLIC, "abc", "builtins", "typing"}
    place = innermost(error, packages or {_PUBLIC}) or _definition(law)
    return f"{type(error).__name__}: {error}" + (f", at {place}" if place else "")


def innermost(error: BaseException, packages: Collection[str]) -> str:
    """Return ``FILE:LINE`` of the innermost call within some packages that an exception went through; empty if none."""
    if isinstance(error, SyntaxError) and error.filename:
        return f"{error.filename}:{error.lineno}"
    place = ""
    for frame, line in traceback.walk_tb(error.__traceback__):
        if _package(str(frame.f_globals.get("__name__", ""))) in packages:
            place = f"{frame.f_code.co_filename}:{line}"
    return place


def _definition(law: type) -> str:
    with suppress(OSError, TypeError):  # the source is not at hand
        return f"{inspect.getsourcefile(law)}:{inspect.getsourcelines(law)[1]}"
    return ""


def _package(module: str) -> str:
    return module.partition(".")[0]
