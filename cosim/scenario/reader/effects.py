"""Effects of sensors and actuators."""

from __future__ import annotations

import math
from collections.abc import Iterable

from cosim.errors import InputError
from cosim.scenario.reader.element import Element
from cosim.scenario.reader.entries import POSE, TORQUE
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import Effect

_NOT_NEGATIVE = ("noise", "quantisation")
_PARTS = {"dropout": "probability", "effectiveness": "factor"}
_LIMITS = {"saturation": "N.m", "rate": "N.m/s"}


def effects(element: Element, tag: str, times: Times) -> tuple[Effect, ...]:
    """Read the effects of the sensor or the actuator in an element."""
    found = tuple(effect for own in element.children(tag) for child in own.inside for effect in _effect(child, times))
    _check_delays((effect for effect in found if effect.kind == "delay"), times)
    return found


def _effect(element: Element, times: Times) -> list[Effect]:
    kind, where = element.kind, element.where
    start, stop = times.window(element)
    if kind in ("noise", "bias", "quantisation"):
        read = element.not_negative if kind in _NOT_NEGATIVE else element.quantity
        names = [name for name in element.attributes if name in POSE]
        return [Effect(kind, read(name, POSE[name]), (name,), start, stop, where) for name in names]
    channels = tuple(element.get("channels").split())
    if kind == "delay":
        return [Effect(kind, times.steps(element, "time") * times.step, channels, 0.0, math.inf, where)]
    if kind in _LIMITS:
        return [Effect(kind, element.positive("limit", _LIMITS[kind]), channels, start, stop, where)]
    part = float(element.get(_PARTS[kind], "nan"))
    if not 0 <= part <= 1:
        raise element.error(f'{_PARTS[kind]}="{element.get(_PARTS[kind])}" of <{kind}> is not from 0 to 1')
    return [Effect(kind, part, channels, start, stop, where)]


def _check_delays(delays: Iterable[Effect], times: Times) -> None:
    """Check that the delays of a channel, which add up, are not longer than the run."""
    total = dict.fromkeys((*POSE, *TORQUE), 0.0)
    for delay in delays:
        for channel in delay.channels or total:
            total[channel] = total.get(channel, 0.0) + delay.amount
        longest = max(total.values())
        if longest > times.horizon + 0.5 * times.step:
            raise InputError(
                f"the delays of a channel add up to {longest:g} s, longer than the run of {times.horizon:g} s",
                delay.where,
            )
