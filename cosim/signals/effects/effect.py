"""The base of all kinds of effects: they are read, and change the values of channels tick by tick."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.errors import Location
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import EffectSource
from cosim.signals.random import NO_STREAMS, Streams
from plants import units

Floats: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class Effect:
    """One thing that a sensor or an actuator does to some of its channels, in a window of time.

    Attributes
    ----------
    kind : str
        The element's name.
    amount : float
        Standard deviation, bias, step, limit, delay, probability or factor, in `unit`.
    channels : tuple of str
        Names of pose entries or commands; empty for all.
    start, stop : float
        The window [s], the second excluded.
    unit : str
        Empty for a pure number.
    stream : str
        The number of its stream of random numbers, where one is stated.
    """

    kind: str
    amount: float
    channels: tuple[str, ...]
    start: float
    stop: float
    where: Location
    unit: str = ""
    stream: str = ""

    @property
    def text(self) -> str:
        """Kind and amount in words."""
        return f"{self.kind} {self.amount:g} {self.unit}".rstrip()


@dataclass(frozen=True)
class Rows:
    """The robots whose channels are changed, one a row.

    Attributes
    ----------
    robots : sequence of str
        Their names, which with `seed` and the channels' names fix all random numbers.
    channels, effects : sequences
        Names of the channels, and the effects, of each robot.
    step : float
        Communication step [s].
    at_rest : bool
        Whether there is nothing before the first tick; otherwise it is as at the first tick.
    """

    seed: int
    robots: Sequence[str]
    channels: Sequence[Sequence[str]]
    effects: Sequence[Sequence[Effect]]
    step: float
    at_rest: bool

    @property
    def width(self) -> int:
        """The most channels that a robot has."""
        return max(map(len, self.channels), default=0)


@dataclass(frozen=True, eq=False)
class Plan:
    """How the amounts of an effect come about, for those who make them elsewhere than `EffectKind.amounts` does.

    Attributes
    ----------
    switches : tuple of int
        The ticks from which on there are other levels; the first is 0.
    levels : ndarray
        Levels (switches, robots, channels): the amounts themselves, but where streams of random numbers are drawn.
    normal : tuple
        Streams of normal numbers, one a tick: robot, purpose, and the flat place (robots, channels) of the channel
        whose amount is its level times that number.
    losses : tuple
        Streams of numbers from 0 to 1, one a tick: robot, purpose, probability, flat places, first tick and the tick
        behind the last one. Amounts are 1 where the number is below the probability, in these ticks but the very first.
    """

    switches: tuple[int, ...]
    levels: Floats
    normal: tuple[tuple[str, str, int], ...] = ()
    losses: tuple[tuple[str, str, float, tuple[int, ...], int, int], ...] = ()


Act: TypeAlias = Callable[[int, Floats, Floats, Floats], None]
"""Changes the values (robots, channels) of a tick in place: tick, values, amounts (robots, channels) of this tick, and
the memory (arrays, robots, channels) of the effect, which is zero at first. Compiled code calls it tick after tick from
0, so it is a `cosim.compiled.compiled` function."""


class EffectKind(ABC):
    """A kind of effect: an instance changes the channels of all robots as their effects of this kind say.

    A kind is one module of this folder, which is found by itself, and an entry of the schema.

    Attributes
    ----------
    element : str
        The element's name; empty for a base of several kinds.
    order : int
        Kinds are applied by this number, whatever the order in which they are written.
    act : callable
        The compiled function that changes values.
    remembers : int
        How many arrays (robots, channels) it keeps from tick to tick.
    """

    element: ClassVar[str] = ""
    order: ClassVar[int]
    act: Act
    remembers = 0

    def __init__(self, rows: Rows) -> None:
        self.rows = rows

    def restart(self, rows: Rows) -> None:
        """Go back to before the first tick, of the same rows with another seed; a kind that draws begins anew."""
        self.rows = rows

    @classmethod
    @abstractmethod
    def read(cls, written: EffectSource, channels: Mapping[str, str], times: Times) -> Iterable[Effect]:
        """Read an element.

        Parameters
        ----------
        written
            The element.
        channels
            The unit of each channel of the robot, by name.
        times
            The communication points.

        Raises
        ------
        InputError
            A value makes no sense, with the place in the scenario.
        """

    @classmethod  # noqa: B027
    def check(cls, effects: Sequence[Effect], channels: Mapping[str, str], times: Times) -> None:
        """Check all effects of this kind on a robot together."""

    def mark(self) -> None:  # noqa: B027
        """Keep the states of the streams of random numbers that it draws from, as they are now."""

    @property
    def marked(self) -> Streams:
        """The states that were kept."""
        return NO_STREAMS

    def go_on(self, streams: Streams) -> None:  # noqa: B027
        """Let those streams go on from a state that have one there."""

    @abstractmethod
    def amounts(self, first: int, out: Floats) -> None:
        """Write the amounts (ticks, robots, channels) from a tick on, which `act` gets; in order, from tick 0 on."""

    @abstractmethod
    def plan(self) -> Plan:
        """Return how the amounts come about."""


class OfEntries(EffectKind):
    """A kind whose attributes are channels, each with an amount in the channel's unit."""

    signed: ClassVar[bool] = False

    @classmethod
    def read(cls, written: EffectSource, channels: Mapping[str, str], times: Times) -> Iterator[Effect]:
        """Read one effect for each channel; the amount of a channel that the robot lacks is not looked at."""
        read = written.quantity if cls.signed else written.not_negative
        for name in written.attributes:
            if name in ("from", "to"):
                continue
            unit = channels.get(name, "")
            amount = read(name, unit) if name in channels else 0.0
            yield Effect(cls.element, amount, (name,), written.start, written.stop, written.where, unit)


class Part(EffectKind):
    """A kind whose amount is a number from 0 to 1."""

    attribute: ClassVar[str]

    @classmethod
    def read(cls, written: EffectSource, channels: Mapping[str, str], times: Times) -> Iterator[Effect]:
        """Read the effect."""
        text = written.get(cls.attribute)
        if not 0 <= (part := float(text)) <= 1:
            raise written.error(f'{cls.attribute}="{text}" of <{cls.element}> is not from 0 to 1')
        window = written.start, written.stop
        yield Effect(cls.element, part, written.channels, *window, written.where, stream=written.get("stream"))


class Limit(EffectKind):
    """A kind whose amount is a limit of the channels, or of their rates."""

    of_rate: ClassVar[bool] = False

    @classmethod
    def read(cls, written: EffectSource, channels: Mapping[str, str], times: Times) -> Iterator[Effect]:
        """Read one effect for all channels of a unit, in this unit; the limit must fit every channel."""
        limited: dict[str, list[str]] = {}
        for name in written.channels or channels:
            limited.setdefault(channels.get(name, ""), []).append(name)
        for own, names in limited.items():
            unit = units.per_second(own) if cls.of_rate and own else own
            amount = written.positive("limit", unit) if unit else 0.0
            those = tuple(names) if len(limited) > 1 else written.channels
            yield Effect(cls.element, amount, those, written.start, written.stop, written.where, unit)
