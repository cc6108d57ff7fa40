"""Actuators: from commanded torques and speeds to acting ones."""

from __future__ import annotations

from collections.abc import Sequence

from cosim.signals.chain import Chain
from cosim.signals.effects import Effect, Rows


def actuators(channels: Sequence[Sequence[str]], effects: Sequence[Sequence[Effect]], step: float) -> Chain:
    """Return delay, rate limit, saturation and loss of effectiveness of every command of robots, in this order.

    Parameters
    ----------
    channels, effects
        Names of the commands and effects of the actuators, of each robot.
    step
        Communication step [s].
    """
    robots = [""] * len(channels)  # no actuator draws random numbers
    return Chain(Rows(0, robots, channels, effects, step, at_rest=True))
