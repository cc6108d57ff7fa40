"""A variable of a result: its name, dimensions, units and description."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class ResultVariable:
    """A variable of a result.

    Attributes
    ----------
    name : str
        Name in ``result.nc``.
    dims, shape : tuple
        Dimensions and shape after ``time``.
    units, long_name : str
        Description for a reader.
    singular_at_zero : str
        Description of the singularity where it is zero, if there is one.
    singular_below : float
        Magnitude below which it is near the singularity; zero if only changes of sign count.
    robots : tuple of str
        Of a controllers' signal: the followers that have it.
    """

    name: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    units: str
    long_name: str
    singular_at_zero: str = ""
    singular_below: float = 0.0
    robots: tuple[str, ...] = ()

    @property
    def attributes(self) -> dict[str, str | float]:
        """The attributes of the variable in a result."""
        attributes: dict[str, str | float] = {"units": self.units, "long_name": self.long_name}
        if self.singular_at_zero:
            attributes |= {"singular_at_zero": self.singular_at_zero, "singular_below": self.singular_below}
        if self.robots:
            attributes["robots"] = " ".join(self.robots)
        return attributes

    @property
    def bytes_per_sample(self) -> int:
        """Memory of one sample."""
        return 8 * math.prod(self.shape)
