"""Kinds of things that are one module of a folder each, found by the element that they stand for."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from pkgutil import iter_modules
from typing import Any


def kinds_in(package: str, path: Iterable[str], base: type[Any]) -> dict[str, type[Any]]:
    """Return the classes in the modules of a package that name an element of scenarios, by this name.

    Parameters
    ----------
    package, path
        The package's ``__name__`` and ``__path__``.
    base
        Their base class; the class attribute ``element`` names the element, and is empty for a class that
        several kinds have in common.
    """
    modules = [import_module(f"{package}.{module.name}") for module in iter_modules(path)]
    classes = {value for module in modules for value in vars(module).values() if isinstance(value, type)}
    found = [value for value in classes if issubclass(value, base)]
    return {element: value for value in found if (element := getattr(value, "element", ""))}
