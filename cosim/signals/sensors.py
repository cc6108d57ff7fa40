"""Sensors: from a robot's true pose to the pose that controllers get."""

from __future__ import annotations

from collections.abc import Sequence

from cosim.signals.chain import Chain, again
from cosim.signals.effects import Effect, Rows


def pose_sensors(
    seed: int,
    robots: Sequence[str],
    channels: Sequence[Sequence[str]],
    effects: Sequence[Sequence[Effect]],
    step: float,
    before: Chain | None = None,
) -> Chain:
    """Return delay, bias, white Gaussian noise, quantisation and dropout of every pose entry of robots, in this order.

    Parameters
    ----------
    seed, robots, channels
        Name the random streams: one for each robot and pose entry, and one for each of its dropouts.
    effects
        The effects of each robot's sensor.
    step
        Communication step [s].
    before
        The sensors of an earlier run that has ended, which are taken if only the seed differs.
    """
    return again(before, Rows(seed, robots, channels, effects, step, at_rest=False))
