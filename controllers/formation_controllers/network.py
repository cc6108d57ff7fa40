"""The radial-basis-function network of (11), with every centre mu_k on the diagonal (mu_k, ..., mu_k)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from formation_controllers.compiled import part
from formation_controllers.elementary import exp
from formation_controllers.errors import GainError
from formation_controllers.gains import Gains, gain
from formation_controllers.interface import Floats


@dataclass(frozen=True, kw_only=True)
class NetworkGains(Gains):
    """Centres and widths of a network; the defaults are those printed in section 5.1."""

    centres: Sequence[float] = gain(
        (-4.0, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0, 4.0),
        "μ_k",
        "1",
        "centres of the basis functions, (11); each stands for a vector of that value",
        size=None,
    )
    widths: float | Sequence[float] = gain(
        10.0, "λ_k", "1", "widths of the basis functions, (11); one for all or one each", size=None, above=0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        n = np.size(self.centres)
        if np.size(self.widths) not in (1, n):
            raise GainError(
                f"gain 'widths' has {np.size(self.widths)} entries: expected 1, or {n} as there are centres"
            )
        object.__setattr__(self, "widths", tuple(np.broadcast_to(self.widths, n).tolist()))


def columns(inputs: int, centres: int) -> dict[str, tuple[int, ...]]:
    """Return name and shape, per robot, of the columns of `basis`."""
    return {"x": (inputs,), "centres": (centres,), "widths": (centres,), "sigma": (centres,)}


@part
def sigma_of(c: np.void, r: int, count: int) -> Floats:
    """Return sigma of one robot out of a block of so many."""
    sigma: Floats = c["sigma"]
    return sigma.reshape(sigma.size)[r : len(sigma) * count : count]


@part
def basis(c: np.void, gains: NDArray[np.void], first: int, count: int) -> None:
    """Fill sigma_k(x) = exp(-|x - mu_k|^2 / lambda_k^2), (11), for a block of robots, given x.

    Sigma has no gaps between its numbers: centre by centre, one a robot of the block. `sigma_of` takes out a robot's.
    """
    x, centres, widths = c["x"], c["centres"], c["widths"]
    sigma = c["sigma"].reshape(c["sigma"].size)
    for r in range(count):
        own = gains[first + r]
        for k in range(len(centres)):
            centres[k, r], widths[k, r] = own["centres"][k], own["widths"][k]
    for k in range(len(centres)):
        for r in range(count):
            distance_squared = 0.0
            for j in range(len(x)):
                difference = x[j, r] - centres[k, r]
                distance_squared += difference * difference
            sigma[k * count + r] = -distance_squared / (widths[k, r] * widths[k, r])
    for i in range(len(centres) * count):
        sigma[i] = exp(sigma[i])


@part
def output(W: Floats, sigma: Floats, m: int) -> float:
    """Return entry m of W sigma, (11)."""
    total = 0.0
    for k in range(W.shape[1]):
        total += W[m, k] * sigma[k]
    return total
