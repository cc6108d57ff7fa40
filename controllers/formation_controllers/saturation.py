"""Behaviour of a law while its torque is beyond the limit of the actuators."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from formation_controllers.compiled import part
from formation_controllers.gains import gain
from formation_controllers.interface import Signal
from formation_controllers.singularities import GuardGains


@dataclass(frozen=True, kw_only=True)
class LimitGains(GuardGains):
    """Gains of a law with integrals or adaptation about actuators."""

    torque_limit: float = gain(
        math.inf,
        "-",
        "N.m",
        "torque beyond which integrals and adaptation are held; inf: never",
        above=0,
        finite=False,
    )


HELD_SIGNAL: Final = Signal("held", "1", "1 where the gain `torque_limit` held integrals and adaptation, else 0")
"""Telemetry of every law that has a `torque_limit`."""


@part
def beyond(tau_1: float, tau_2: float, limit: float) -> bool:
    """Tell whether a torque is beyond the limit of the actuators."""
    return abs(tau_1) > limit or abs(tau_2) > limit


@part
def clipped(torque: float, limit: float) -> float:
    """Return the torque that an actuator with this limit applies."""
    return min(max(torque, -limit), limit)
