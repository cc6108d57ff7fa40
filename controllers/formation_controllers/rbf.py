"""The radial-basis-function network of (11), with every centre mu_k on the diagonal (mu_k, ..., mu_k)."""

from __future__ import annotations

import math

from formation_controllers.compiled import compiled
from formation_controllers.interface import Floats


@compiled
def basis(x: Floats, centres: Floats, widths: Floats, sigma: Floats) -> None:
    """Fill sigma_k(x) = exp(-|x - mu_k|^2 / lambda_k^2), (11)."""
    for k in range(len(centres)):
        distance_squared = 0.0
        for j in range(len(x)):
            difference = x[j] - centres[k]
            distance_squared += difference * difference
        sigma[k] = math.exp(-distance_squared / (widths[k] * widths[k]))


@compiled
def output(W: Floats, sigma: Floats, m: int) -> float:
    """Return entry m of W sigma, (11)."""
    total = 0.0
    for k in range(len(sigma)):
        total += W[m, k] * sigma[k]
    return total
