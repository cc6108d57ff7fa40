"""The plants of a fleet that run in other processes: one for all robots of an FMU, unless each needs its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.plant.bells import BELL, Bells, Heard, bells_of, can_ring, no_bells
from cosim.plant.failures import NoInstance
from cosim.plant.local import NotStarted
from cosim.plant.member import Member
from cosim.plant.message import Message
from cosim.plant.process import PlantProcess, end
from cosim.plant.saved import PlantState
from cosim.plant.spec import Value
from cosim.plant.stepping import Rows
from cosim.undisturbed import undisturbed


@dataclass(frozen=True)
class _Home:
    """A process, the numbers of its plants in the fleet, and where their inputs and outputs are in the fleet's."""

    process: PlantProcess
    plants: tuple[int, ...]
    inputs: NDArray[np.int64]
    outputs: NDArray[np.int64]


class Elsewhere:
    """Plants in other processes, by their numbers in the fleet.

    Legal call order: `start` and `bells`; then steps, each begun and completed by `begin`, `finish` and `failures`, of
    which compiled code may do the first two; `change` and `messages` in between; `start` and `bells` again for another
    run; `close` at the end.

    Parameters
    ----------
    often
        Whether there are to be many runs.
    """

    def __init__(self, often: bool = False) -> None:
        self._often = often
        self._processes: list[PlantProcess] = []
        self._plants: list[tuple[int, ...]] = []
        self._homes: list[_Home] = []
        self._alone: set[str] = set()  # FMUs that have refused a second instance

    @property
    def can_ring(self) -> bool:
        """Whether compiled code can step the plants, if there are any."""
        return not self._processes or can_ring()

    @property
    def companions(self) -> tuple[int, ...]:
        """The numbers of the processes."""
        return tuple(home.process.number for home in self._homes)

    def start(self, members: Sequence[Member]) -> None:
        """Start those plants of a fleet that run elsewhere.

        Processes that are there go on with the same plants, unless something has gone wrong in one of them. An FMU that
        refuses a second instance in a process gets one for each robot.

        Raises
        ------
        NotStarted
            One of them cannot be started.
        """
        if self._restarted(members):
            return
        while True:
            self.close()
            try:
                self._start(members)
                return
            except NotStarted as error:
                directory = members[error.index].spec.directory
                first = next(i for i, member in enumerate(members) if member.spec.directory == directory)
                if not isinstance(error.error, NoInstance) or directory in self._alone or error.index == first:
                    raise
                self._alone.add(directory)

    def bells(self, rows: Rows) -> Bells:
        """Return the processes for compiled code, and write their first outputs into the rows of the fleet."""
        self._rows = rows
        self._homes = [
            _Home(process, plants, _places(rows.first_input, plants), _places(rows.first_output, plants))
            for process, plants in zip(self._processes, self._plants, strict=True)
        ]
        for home in self._homes:
            rows.outputs[home.outputs] = home.process.board.outputs
        if not self._homes or not can_ring():
            return no_bells()
        boards = [home.process.board for home in self._homes]
        places = [(home.inputs, home.outputs) for home in self._homes]
        return bells_of(self._bells, boards, places, rows.inputs, rows.outputs)

    def begin(self, time: float, step: float) -> None:
        """Let all plants begin a step, with their inputs given; they go on beside the harness."""
        for home in self._homes:
            home.process.board.inputs[:] = self._rows.inputs[home.inputs]
            home.process.begin(time, step)

    def finish(self) -> None:
        """Wait for the end of the steps of which nothing has been heard yet."""
        for home in self._homes:
            if home.process.heard == Heard.NOTHING:
                home.process.finish()
                self._rows.outputs[home.outputs] = home.process.board.outputs

    def failures(self) -> dict[int, str]:
        """Return the failure of each plant that has failed in the last step."""
        return {home.plants[own]: said for home in self._homes for own, said in home.process.failures().items()}

    def change(self, index: int, values: Sequence[Value]) -> None:
        """Give parameters of a plant other values; see `PlantProcess.change`."""
        home = self._home_of(index)
        home.process.change(home.plants.index(index), values)

    def saved(self, index: int) -> PlantState:
        """Return the state of a plant; see `PlantProcess.saved`."""
        home = self._home_of(index)
        return home.process.saved(home.plants.index(index))

    def restore(self, index: int, state: PlantState) -> None:
        """Let a plant go on from a saved state; see `PlantProcess.restore`."""
        home, rows = self._home_of(index), self._rows
        home.process.restore(home.plants.index(index), state)
        rows.inputs_of(index)[:], rows.outputs_of(index)[:] = state.inputs, state.outputs
        home.process.board.inputs[:] = rows.inputs[home.inputs]

    def messages(self) -> Iterator[tuple[int, str, list[Message]]]:
        """Take the messages of the plants since the last time; see `LocalPlants.messages`."""
        for home in self._homes:
            for own, said, data in home.process.messages():
                yield home.plants[own], said, data

    def close(self) -> None:
        """End all plants with their processes."""
        with undisturbed():
            processes, self._processes, self._homes = self._processes, [], []
            end(processes)

    def _home_of(self, index: int) -> _Home:
        return next(home for home in self._homes if index in home.plants)

    def _restarted(self, members: Sequence[Member]) -> bool:
        """Put the plants at the start of another run; return whether that was possible."""
        if not self._processes or not all(process.can_restart for process in self._processes):
            return False
        try:
            for process, plants in zip(self._processes, self._plants, strict=True):
                process.restart([members[index].spec for index in plants])
            for process in self._processes:
                process.wait_until_started()
        except NotStarted:  # perhaps as it has been used
            return False
        return True

    def _start(self, members: Sequence[Member]) -> None:
        groups: dict[object, list[int]] = {}
        for index, member in enumerate(members):
            if member.isolated:
                directory = member.spec.directory
                groups.setdefault(index if member.alone or directory in self._alone else directory, []).append(index)
        self._plants = [tuple(plants) for plants in groups.values()]
        self._bells = np.zeros(len(groups), BELL)
        for number, plants in enumerate(self._plants):
            with _numbered(plants):
                specs = [members[index].spec for index in plants]
                with undisturbed():
                    self._processes.append(PlantProcess(specs, self._bells[number : number + 1], self._often))
        for process, plants in zip(self._processes, self._plants, strict=True):
            with _numbered(plants):
                process.wait_until_started()


@contextmanager
def _numbered(plants: Sequence[int]) -> Iterator[None]:
    """Let NotStarted have the number of the plant in the fleet."""
    try:
        yield
    except NotStarted as error:
        raise NotStarted(plants[error.index], error.error) from None


def _places(first: NDArray[np.int64], plants: Sequence[int]) -> NDArray[np.int64]:
    """Return where the numbers of plants are in those of the fleet."""
    return np.concatenate([np.arange(first[index], first[index + 1]) for index in plants])
