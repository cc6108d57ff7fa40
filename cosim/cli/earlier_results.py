"""Keeps the results of an earlier run of a scenario when a run with other changes takes their place."""

from __future__ import annotations

import hashlib
import os
import re
from pathlib import Path

from cosim.results.netcdf import attributes_of
from cosim.results.provenance import Provenance

RESULT, FILES = "result.nc", ("summary.json", "figure.png", "result.nc")
"""The files of a run. The result is moved last, because it identifies the run."""
_LONGEST = 60


def set_aside(folder: Path, coming: Provenance) -> tuple[Path, Provenance] | None:
    """Move the files of an earlier run out of a folder if it was of another file or changed otherwise.

    They go to a folder beside it that is named after its changes. An earlier run of the same file and changes stays
    where it is, to be overwritten.

    Returns
    -------
    tuple or None
        The new place of the files, and their provenance; None if there is nothing to keep.
    """
    earlier = _provenance(folder / RESULT)
    if earlier is None or earlier.variant == coming.variant:
        return None
    place = folder.with_name(f"{folder.name}+{_label(earlier, folder.name)}")
    place.mkdir(exist_ok=True)
    for name in FILES:
        (place / name).unlink(missing_ok=True)
        if (folder / name).exists():
            os.replace(folder / name, place / name)
    return place, earlier


def _provenance(path: Path) -> Provenance | None:
    """Return the provenance of a result; None if there is no result, or one without provenance."""
    try:
        attributes = attributes_of(path)
        return Provenance.of(attributes) if "changes" in attributes else None
    except Exception:  # no result that can be kept
        return None


def _label(provenance: Provenance, name: str) -> str:
    """Return a short name of a file and changes, another one for others."""
    stem = Path(provenance.file).stem
    parts = [stem] if stem != name else []
    parts += [change.removeprefix("--set ").removeprefix("--").replace(" ", "=", 1) for change in provenance.changes]
    if not provenance.changes:
        parts.append("unchanged")
    exact = "+".join(parts)
    short = "+".join(re.sub(r"[^\w.=-]+", "_", part).replace("=_", "=").strip("_") for part in parts)[:_LONGEST]
    return short if short == exact else f"{short}-{hashlib.sha256(exact.encode()).hexdigest()[:8]}"
