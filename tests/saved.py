"""What a run has saved, as far as tests of short runs ask: the whole file as a dataset takes longer than they do."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Saved:
    """The attributes of a result, how many samples it has, and the followers' poses at them."""

    attrs: dict[str, str]
    samples: int
    pose: NDArray[np.float64]


def saved(file: Path) -> Saved:
    """Read a result."""
    with h5py.File(file) as read:
        return Saved(dict(read.attrs), len(read["time"]), read["pose"][:])
