"""The scenarios that come with Formation: beside the package in a checkout, within it where it is installed."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).parents[1]


def examples() -> tuple[Path, ...]:
    """Return the scenarios that come with Formation, with the files that they refer to, in one flat folder."""
    installed, checkout = _PACKAGE / "scenarios", _PACKAGE.parent / "scenarios"
    folder = installed if installed.is_dir() else checkout
    return tuple(sorted(path for path in folder.glob("*") if path.is_file() and not path.name.startswith(".")))
