"""Actuators: from commanded torques and speeds to acting ones."""

from __future__ import annotations

from collections.abc import Sequence

from cosim.signals.chain import Chain, again
from cosim.signals.effects import Effect, Rows


def actuators(
    channels: Sequence[Sequence[str]], effects: Sequence[Sequence[Effect]], step: float, before: Chain | None = None
) -> Chain:
    """Return delay, rate limit, saturation and loss of effectiveness of every command of robots, in this order.

    Parameters
    ----------
    channels, effects
        Names of the commands and effects of the actuators, of each robot.
    step
        Communication step [s].
    before
        The actuators of an earlier run that has ended, which are taken if nothing differs.
    """
    robots = [""] * len(channels)  # no actuator draws random numbers
    return again(before, Rows(0, robots, channels, effects, step, at_rest=True))
