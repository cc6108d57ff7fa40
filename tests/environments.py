"""Python environments for tests, made in a moment: no network, nothing is copied."""

import sys
import venv
from collections.abc import Iterable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
LIBRARIES = Path(np.__file__).parents[1]
CONTROLLERS = ROOT / "controllers"


def environment(folder: Path, *found: Path) -> Path:
    """Make an environment that finds modules in some folders and, after them, the libraries of this one."""
    venv.create(folder, with_pip=False, symlinks=sys.platform != "win32")
    (packages_of(folder) / "found.pth").write_text("".join(f"{path}\n" for path in (*found, LIBRARIES)))
    return folder


def packages_of(folder: Path) -> Path:
    """Return where an environment has its packages."""
    (packages,) = folder.glob("[Ll]ib/**/site-packages")
    return packages


def distribution(packages: Path, name: str, version: str, laws: Iterable[str], text: str = "") -> None:
    """Install a distribution with controllers, each ``NAME = MODULE:CLASS``, and a module of its name with a text."""
    about = packages / f"{name.replace('-', '_')}-{version}.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    (about / "entry_points.txt").write_text("\n".join(["[formation.controllers]", *laws, ""]))
    if text:
        (packages / f"{name.replace('-', '_')}.py").write_text(text)
