"""The base of all kinds of waves: they are read, and give samples at the communication points."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cosim.clock import acting
from cosim.scenario.csv_table import Table
from cosim.scenario.scenario import WaveSource
from plants import units


@dataclass(frozen=True)
class Sampling:
    """At which points in time, in which unit and with which random numbers samples are wanted.

    Attributes
    ----------
    times : ndarray
        The communication points (T,) [s], in steps of `step`.
    step : float
        Communication step [s].
    unit : Unit
        The unit.
    stream : Generator
        The stream of random numbers, from which earlier communication points have taken theirs.
    """

    times: NDArray[np.float64]
    step: float
    unit: units.Unit
    stream: np.random.Generator


class Wave(ABC):
    """A kind of wave: an instance is one element of a scenario, with its attributes read.

    A kind is one module of this folder, which is found by itself, and an entry of the schema.

    Attributes
    ----------
    element : str
        The element's name; empty for a base of several kinds.
    keeps_a_value : bool
        Whether it has one value as long as it acts, so that this may be true, an item or a text.
    """

    element: ClassVar[str] = ""
    keeps_a_value: ClassVar[bool] = False

    def __init__(self, written: WaveSource) -> None:
        self.written = written

    @abstractmethod
    def samples(self, sampling: Sampling) -> NDArray[np.float64]:
        """Return its values (T,); an instance is asked for one part of a run after the other, from time 0 on.

        Raises
        ------
        InputError
            A value's unit does not fit, a table cannot be used, or a number is out of range.
        """

    @property
    def value(self) -> str:
        """How large it is, as it is written: which unit fits is known from the plant. Empty if another file says it."""
        return self.written.get("value")

    @property
    def text(self) -> str:
        """The wave in words."""
        return f"{self.element} {self.value}"

    def table(self) -> tuple[Table, str] | None:
        """Return the table that it is from, and the column; None if it is from none."""
        return None

    def amount(self, sampling: Sampling) -> float:
        """Return its value as a number."""
        return self.written.quantity("value", sampling.unit)

    def acting(self, times: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return at which communication points it acts: from its start on, until before its end."""
        return acting(times, self.written.start, self.written.stop)


class Kept(Wave):
    """A value that is kept as long as the wave acts; zero otherwise."""

    keeps_a_value = True

    def samples(self, sampling: Sampling) -> NDArray[np.float64]:
        """Return the value where it acts."""
        return np.where(self.acting(sampling.times), np.full(len(sampling.times), self.amount(sampling)), 0.0)
