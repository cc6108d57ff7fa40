"""Projection-type updates of the weights and of the robust gain, (28) to (30): as rates and by explicit Euler steps.

A step along the boundary leaves the ball tr(W'W) <= W_m, so that the weights are scaled back onto it
afterwards. Rounding then decides on which side of the boundary they are; a value within 1e-9 of it counts as
on it.
"""

from __future__ import annotations

import math

from formation_controllers.compiled import part
from formation_controllers.interface import Floats

ON_BOUND = 1.0 - 1e-9
"""The share of the bound from which on weights are taken to be on it."""


@part
def norm_squared(W: Floats) -> float:
    """Return tr(W'W), the squared Frobenius norm."""
    total = 0.0
    for m in range(W.shape[0]):
        for k in range(W.shape[1]):
            total += W[m, k] * W[m, k]
    return total


@part
def outward(W: Floats, trace: float, s: Floats, sigma: Floats, W_m: float) -> float:
    """Return the factor c by which (29) takes the outward part away: W_dot = gamma_w (s sigma' - c W).

    The trace is tr(W'W).
    """
    if trace < W_m * ON_BOUND:
        return 0.0
    growth = 0.0  # sigma' W' s
    for m in range(W.shape[0]):
        for k in range(W.shape[1]):
            growth += s[m] * W[m, k] * sigma[k]
    return growth / trace if growth > 0.0 else 0.0


@part
def weight_rates(W: Floats, trace: float, s: Floats, sigma: Floats, gamma_w: float, W_m: float, W_dot: Floats) -> None:
    """Fill the rates of the weights, (28) and (29): the continuous form of `step_weights`."""
    c = outward(W, trace, s, sigma, W_m)
    for m in range(W.shape[0]):
        for k in range(W.shape[1]):
            W_dot[m, k] = gamma_w * (s[m] * sigma[k] - c * W[m, k])


@part
def gain_rate(theta: float, s_norm: float, gamma_theta: float, theta_m: float) -> float:
    """Return the rate of the robust gain, (28) and (30): the continuous form of `step_gain`."""
    return gamma_theta * s_norm if theta < theta_m else 0.0


@part
def step_weights(W: Floats, trace: float, s: Floats, sigma: Floats, gamma_w: float, W_m: float, period: float) -> None:
    """Advance the weights by (28) and (29) over one period, in place, with tr(W'W) <= W_m afterwards."""
    c = outward(W, trace, s, sigma, W_m)
    for m in range(W.shape[0]):
        for k in range(W.shape[1]):
            W[m, k] += period * gamma_w * (s[m] * sigma[k] - c * W[m, k])
    trace = norm_squared(W)
    if trace > W_m:
        shrink = math.sqrt(W_m / trace)
        for m in range(W.shape[0]):
            for k in range(W.shape[1]):
                W[m, k] *= shrink


@part
def step_gain(theta: float, s_norm: float, gamma_theta: float, theta_m: float, period: float) -> float:
    """Advance the robust gain by (28) and (30) over one period; it never exceeds theta_m."""
    return min(theta + period * gamma_theta * s_norm, theta_m)
