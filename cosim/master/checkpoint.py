"""A checkpoint: the state of a run before a tick, with its records up to then and everything needed to go on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.master.checkpoint_file import CheckpointFile, write_checkpoint
from cosim.master.origin import Origin
from cosim.master.recorder import Recorder
from cosim.master.run_state import RunState
from cosim.results.provenance import Part
from cosim.scenario.scenario import Scenario


@dataclass(frozen=True)
class Start:
    """The state of a run from which another one goes on.

    Attributes
    ----------
    scenario : Scenario
        The scenario up to then.
    state : RunState
        The state.
    fill : callable
        Writes what was recorded up to then into a recorder.
    parts : tuple of Part
        The parts that the run has by then, the one that ends there included.
    """

    scenario: Scenario
    state: RunState
    fill: Callable[[Recorder], None]
    parts: tuple[Part, ...]


@dataclass(frozen=True)
class Snapshot:
    """A checkpoint that is to be written: nothing in it changes any more.

    Attributes
    ----------
    facts, arrays
        As for `write_checkpoint`.
    tick : int
        The tick of the state.
    """

    facts: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]
    tick: int

    @classmethod
    def of(
        cls,
        origin: Origin,
        state: RunState,
        recorder: Recorder,
        first: int = 0,
        before: str = "",
        every: int | None = None,
    ) -> Self:
        """Return the checkpoint of a state.

        Parameters
        ----------
        origin
            Where it comes from.
        state
            The state.
        recorder
            What is recorded; it may go on.
        first
            The first tick whose records are kept here.
        before
            The name of the file beside it that holds those before.
        every
            How many ticks lie between two checkpoints of the run, if it writes some.
        """
        about, arrays = state.to_parts()
        numbers = recorder.numbers(first, state.tick)
        arrays |= {f"records/{index}": place for index, place in enumerate(numbers)}
        arrays["origin"] = np.frombuffer(origin.as_json, np.uint8)
        return cls({"state": about, "first": first, "before": before, "every": every}, arrays, state.tick)

    def write(self, path: Path) -> None:
        """Write it whole or not at all; OutputError if that fails."""
        write_checkpoint(path, self.facts, self.arrays)


class Checkpoint:
    """A checkpoint in a file.

    Parameters
    ----------
    path
        The file.

    Attributes
    ----------
    origin : Origin
        Where it comes from.
    state : RunState
        The state.
    every : int or None
        How many ticks lie between two checkpoints of the run, if it wrote some.

    Raises
    ------
    InputError
        There is none, it or one with earlier records is damaged, or it is of another version.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._files = list(_chain(path))
        last = self._files[0]
        with last.understood():
            self.origin = Origin.from_json(last.array("origin").tobytes())
            arrays = {name: last.array(name) for name in last.names if not name.startswith("records/")}
            self.state = RunState.from_parts(last.facts["state"], arrays)
            every = last.facts["every"]
            self.every = None if every is None else int(every)
            if self.every is not None and self.every < 1:
                raise ValueError(f"one is to be written every {self.every} ticks")
            ends = [self.state.tick, *(int(file.facts["first"]) for file in self._files)]
            if any(one < other for one, other in pairwise(ends)) or ends[-1] != 0:
                raise ValueError("its records are not those of all ticks up to it")
        self._bounds = [(first, last) for last, first in pairwise(ends)]

    @property
    def scenario(self) -> Scenario:
        """The scenario of the run."""
        return self.origin.scenario

    @property
    def time(self) -> float:
        """Its communication point [s]."""
        return self.state.tick * self.scenario.step

    def fill(self, recorder: Recorder) -> None:
        """Write what was recorded up to the checkpoint into a recorder of the same variables.

        Raises
        ------
        InputError
            It records others.
        """
        for file, (first, last) in zip(self._files, self._bounds, strict=True):
            places = recorder.numbers(first, last)
            if f"records/{len(places)}" in set(file.names):
                raise file.damaged("it has more records than the run")
            for index, place in enumerate(places):
                with file.understood():
                    file.read_into(f"records/{index}", place)

    def start(self, branched: str | None = None) -> Start:
        """Return from where a run goes on.

        Parameters
        ----------
        branched
            The folder of the run from which it branches off with another scenario, empty for none; None if it goes on
            with the same.
        """
        part = Part(self.time, self.scenario.changes, *(() if branched is None else (self.scenario.text, branched)))
        return Start(self.scenario, self.state, self.fill, (*self.origin.parts, part))


def _chain(path: Path) -> Iterator[CheckpointFile]:
    """Yield a checkpoint, and those that hold the records before it, the latest first."""
    seen: set[str] = set()
    name = path.name
    while name:
        if name in seen or Path(name).name != name or "\0" in name:
            raise InputError(f"the checkpoint {path} is damaged: the one before is {name!r}")
        seen.add(name)
        file = CheckpointFile(path.with_name(name))
        yield file
        with file.understood():
            name = str(file.facts["before"])
