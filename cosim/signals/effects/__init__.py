"""Effects of sensors and actuators: each kind is a module of this folder."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from cosim.errors import InputError, nearest
from cosim.kinds_by_element import kinds_in
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import EffectSource
from cosim.signals.effects.effect import Effect, EffectKind, Rows

__all__ = ["EFFECTS", "Effect", "Rows", "check_channels", "check_values", "understood"]

EFFECTS: Mapping[str, type[EffectKind]] = kinds_in(__name__, __path__, EffectKind)
"""The kinds of effects, by the element's name."""


def understood(
    sources: Iterable[EffectSource], channels: Mapping[str, str], times: Times, whose: str
) -> tuple[Effect, ...]:
    """Return the effects of a sensor or an actuator with their attributes read.

    Parameters
    ----------
    sources
        The elements.
    channels
        The unit of each channel that the robot has, by name.
    times
        The communication points.
    whose
        In messages, whose channels they are.

    Raises
    ------
    InputError
        The robot has no such channel, or a value makes no sense, with the place in the scenario.
    """
    found = check_values(sources, channels, times)
    check_channels(found, list(channels), whose)
    return found


def check_values(sources: Iterable[EffectSource], channels: Mapping[str, str], times: Times) -> tuple[Effect, ...]:
    """Return effects, and refuse values that make no sense for any robot; the amount of an unknown channel is open."""
    found = tuple(effect for written in sources for effect in EFFECTS[written.kind].read(written, channels, times))
    for name, kind in EFFECTS.items():
        kind.check([effect for effect in found if effect.kind == name], channels, times)
    return found


def check_channels(effects: Sequence[Effect], channels: Sequence[str], whose: str) -> None:
    """Check that effects name channels that a robot has.

    Raises
    ------
    InputError
        With the place in the scenario; `whose` says whose channels they are.
    """
    for effect in effects:
        for channel in effect.channels:
            if channel not in channels:
                known = nearest(channel, list(channels))
                raise InputError(f"{whose} has no channel {channel!r}: {known}", effect.where)
