"""The course of a signal in each run of a study, at a few instants, for the picture of all runs.

A course is kept as text with its row: the robots' ids, then numbers in base 64. They have single precision, or double
precision where single would have steps that are seen, as in coordinates of a national grid.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cosim.clock import ROUNDING
from cosim.results.expectations import Kind, Prepare, Recorded, Recording, RunOther
from cosim.results.expectations.subject import Subject
from cosim.results.result import Result
from cosim.results.verdict import Verdict
from cosim.scenario.scenario import Expectation, Scenario
from cosim.scenario.written_element import Written
from plants import UnitError, units

MOST_NUMBERS = 20_000
"""Upper limit for the numbers of one envelope that a run keeps."""
_USUAL_SAMPLES = 200
_MOST_SINGLE = 10_000.0
"""Magnitude up to which numbers have single precision: at most steps of 1 mm in a place [m]."""
_PATH = Subject("pose", "x"), Subject("pose", "y")
_LEADERS_PATH = Subject("leader_pose", "x"), Subject("leader_pose", "y")


@dataclass(frozen=True, eq=False)
class Course:
    """A signal of one run.

    Attributes
    ----------
    robots : tuple of str
        The robots that have it.
    values : ndarray
        (R, T, 1) in the unit that is shown, or the positions (R, T, 2) [m] of a path; NaN where there is none.
    """

    robots: tuple[str, ...]
    values: NDArray[np.float32] | NDArray[np.float64]


class Envelope(Kind):
    """``<envelope>`` in one scenario of a study: it is read and checked as an expectation is, but expects nothing.

    Attributes
    ----------
    of_paths : bool
        Whether it is about the positions of robots, the leader's among them.
    unit : str
        The unit in which values are kept.
    times : ndarray
        The instants (T,) [s].
    """

    def __init__(self, written: Expectation, scenario: Scenario) -> None:
        super().__init__(replace(written, stop=scenario.horizon) if math.isinf(written.stop) else written)
        self.of_paths = is_of_paths(written)
        self.subjects = _PATH if self.of_paths else (Subject.of(written),)
        self.unit = "m" if self.of_paths else written.get("unit")
        first = math.ceil((self.written.start - ROUNDING) / scenario.step)
        last = math.floor((min(self.written.stop, scenario.horizon) + ROUNDING) / scenario.step)
        samples = min(int(written.get("samples", str(_USUAL_SAMPLES))), max(last - first, 0) + 1)
        self.times = np.unique(np.linspace(first, last, samples).round()) * scenario.step

    @property
    def text(self) -> str:
        """The signal in words, with its unit."""
        return "paths [m]" if self.of_paths else f"{self.subjects[0]} [{self.unit}]".removesuffix(" [1]")

    def check(self, own: Recording, prepare: Prepare) -> None:
        """Check signal, unit, robots and window, and that a run keeps little."""
        self.check_within(own.scenario.horizon)
        self.check_samples(own.scenario)
        for subject in self.subjects:
            unit = subject.check(self, own.signals)
            try:
                units.convert(1.0, unit, self.unit)
            except UnitError as error:
                raise self.written.error(f"the unit of the envelope of {str(subject)!r}: {error}") from None
        robots = self._robots(own.signals[self.subjects[0].signal].robots)
        if (numbers := robots * len(self.times) * len(self.subjects)) > MOST_NUMBERS:
            raise self.written.error(
                f"an envelope of {robots} robots at {len(self.times)} instants has {numbers:,} numbers a run, which is "
                f"more than {MOST_NUMBERS:,}: give fewer samples=..., or some of the followers in robots=..."
            )

    def _robots(self, having: Collection[str]) -> int:
        return len(self.written.robots or having) + self.of_paths

    def signals(self, known: Mapping[str, Recorded]) -> Collection[str]:
        """Return the signals that it needs."""
        return {"pose", "leader_pose"} if self.of_paths else self.subjects[0].signals

    def judge(self, result: Result, run_other: RunOther | None) -> list[Verdict]:
        """Return nothing: it is no expectation."""
        return []

    def course(self, result: Result) -> str:
        """Return the course of one run as text."""
        parts = [self._values(result, subject) for subject in self.subjects]
        leaders = [self._values(result, subject) for subject in _LEADERS_PATH] if self.of_paths else [{}]
        found = {
            robot: np.stack([one[robot] for one in group], axis=-1) for group in (leaders, parts) for robot in group[0]
        }
        values = np.stack(list(found.values()))
        far = (np.abs(values[np.isfinite(values)]) > _MOST_SINGLE).any()
        data = values.astype("<f8" if far else "<f4").tobytes()
        return " ".join([*found, base64.b64encode(data).decode("ascii")])

    def _values(self, result: Result, subject: Subject) -> dict[str, NDArray[np.float64]]:
        """Return the values (T,) of each robot at the instants; NaN at those that the run has not."""
        zero, one = (units.convert(value, subject.unit(result), self.unit) for value in (0.0, 1.0))
        found = {}
        for robot, (time, values) in subject.courses(self, result).items():
            places = np.minimum(np.searchsorted(time, self.times - ROUNDING), len(time) - 1)
            there = np.abs(time[places] - self.times) <= ROUNDING
            found[robot] = np.where(there, zero + (one - zero) * values[places], np.nan)
        return found

    def read(self, text: str) -> Course:
        """Return a course from its text."""
        *robots, encoded = text.split(" ")
        shape, data = (len(robots), len(self.times), len(self.subjects)), base64.b64decode(encoded)
        if len(data) == 4 * math.prod(shape):
            return Course(tuple(robots), np.frombuffer(data, "<f4").astype(np.float32).reshape(shape))
        return Course(tuple(robots), np.frombuffer(data, "<f8").astype(np.float64).reshape(shape))


_DIFFERENCES = ("minus", "minus_component", "minus_robot", "than")


def is_of_paths(written: Written) -> bool:
    """Return whether an envelope is about the paths of robots seen from above, and no difference."""
    of_pose = written.get("signal") == "pose" and "component" not in written
    return of_pose and not any(name in written for name in _DIFFERENCES)


def check_envelopes(envelopes: Iterable[Expectation], scenario: Scenario, signals: Mapping[str, Recorded]) -> None:
    """Check that each envelope can be drawn of the runs of a scenario.

    Raises
    ------
    InputError
        A signal, component or follower is not there, a unit or a window does not fit, or it would keep too much.
    """
    for written in envelopes:
        Envelope(written, scenario).check(Recording(scenario, signals), _nothing_else)


def _nothing_else(path: object) -> Recording:
    raise AssertionError("an envelope is about no other scenario")
