"""Masters that are not ours, for tests.

They come with the extra ``bench``, and the TBB that ecos needs. Where one is missing its tests are skipped, unless
FORMATION_REQUIRE_MASTERS is set.
"""

import contextlib
import ctypes
import importlib
import os
import sys
from pathlib import Path

import pytest


def need(name: str) -> None:
    """Skip the test if a master cannot be imported."""
    if name == "ecospy":
        # TBB from the package tbb, where the linker does not look; else the system's
        with contextlib.suppress(OSError):
            ctypes.CDLL(str(Path(sys.prefix, "lib", "libtbb.so.12")), ctypes.RTLD_GLOBAL)
    try:
        importlib.import_module(name)
    except (ImportError, OSError) as error:
        if os.environ.get("FORMATION_REQUIRE_MASTERS"):
            raise
        pytest.skip(f"{name} cannot be imported: {error}")
