"""The plants of a process that serves a harness, and their steps whenever it rings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.compiled import COMPILED, compiled, entry_of
from cosim.frames import Bound, call_bound
from cosim.plant.atomic import load, swap
from cosim.plant.bells import (
    AWAKE,
    BELL,
    BY_PIPE,
    DONE,
    SAYS,
    SIZE,
    STEP,
    board,
    can_ring,
    core_now,
    core_of,
    exchange,
    fill,
    look_for_it,
    no_bells,
    ring_there,
)
from cosim.plant.failures import PlantError
from cosim.plant.fleet_step import (
    LINK,
    CompiledFleet,
    Found,
    fleet_arrays,
    give_inputs,
    load_step,
    step_fleet,
)
from cosim.plant.foreign_modules import make_room
from cosim.plant.local import LocalPlants, NotStarted
from cosim.plant.saved import PlantState
from cosim.plant.spec import CO_SIMULATION, PlantSpec, values_from
from cosim.plant.stepwise import stepper
from cosim.shared_memory import MappedMemory


class Served:
    """The plants of this process, all of one FMU.

    Legal call order: `start` first, `restart` for another run, `close` last.

    Parameters
    ----------
    about
        The plants, and the memory that is shared with the harness.
    requests, replies
        The pipes from and to the harness.
    """

    def __init__(self, about: dict[str, Any], requests: int, replies: int) -> None:
        self._specs = _specs(about)
        sizes = [sum(len(getattr(spec, block).start) for spec in self._specs) for block in ("inputs", "outputs")]
        self.board = board(MappedMemory(about["size"], about["memory"]), *sizes)
        self._failures: dict[int, str] = {}
        self._found = np.zeros(2, dtype=np.int64)
        self._local = LocalPlants(self.board.activity)
        self._bell = np.zeros(1, BELL)
        fill(self._bell, (replies, requests), (self.board.answered, self.board.asked), DONE)
        self.board.activity.listen()
        load_step(any(spec.interface != CO_SIMULATION or spec.fmi == "3.0" for spec in self._specs))
        self._step = CompiledFleet(np.zeros(3, np.int64), self.board.activity.clock, self._found[:1], self._found[1:])
        self._serve = entry_of(serve, self._bell, self.board.told, self.board.tells, self._step)

    def start(self) -> None:
        """Start the plants and read their outputs.

        Raises
        ------
        NotStarted
            One of them cannot be started.
        """
        for spec in self._specs:
            stepper(spec)  # may load a library
        make_room(Path(self._specs[0].directory, "resources"))  # from now on imports may find modules of the FMU
        self._begin()

    def restart(self, about: dict[str, Any]) -> None:
        """Put the plants at the start of another run, with other values.

        Raises
        ------
        NotStarted
            One of them cannot be started.
        """
        self._specs, self._failures = _specs(about), {}
        self._begin()

    def _begin(self) -> None:
        self._local.start(self._specs, range(len(self._specs)), self.board.outputs)
        rows, about = self._local.rows, self.board.activity
        row = np.repeat(range(len(self._specs)), np.diff(rows.first_input))
        links = np.zeros(len(row), LINK)  # numbers are given as they are
        links["row"], links["place"], links["scale"], links["bound"] = row, range(len(row)), 1.0, np.inf
        state = np.zeros((len(self._specs), 0))
        self._arrays = fleet_arrays(rows, links, links[:0], state, about.current, about.pending, no_bells())
        self._bound = Bound(step_fleet, self._arrays, self.board.inputs, about.clock, self._found)
        self._step.call[:] = self._bound.numbers
        about.clock[:] = 0.0
        step_fleet(self._arrays, self.board.inputs, about.clock, self._found)
        if self._found[0] == Found.FAILED:
            index, said = next(iter(self._local.failures().items()))
            raise NotStarted(index, PlantError(f"it {said}"))

    def serve(self) -> bytes:
        """Take steps in compiled code until something else is asked for; return the beginning of that.

        Where there is no compiled code, or it cannot step the plants, nothing is done.
        """
        if not COMPILED or self._local.stepwise or not can_ring():
            return b""
        self._serve(self._bell, self.board.told, self.board.tells, self._step)
        return int(self._bell["answer"][0]).to_bytes(8, "little")[: max(int(self._bell["heard"][0]), 0)]

    def step(self) -> None:
        """Take a step with what the harness has written, and write what comes of it."""
        about = self.board.activity
        try:
            failed = self._stepped(about.clock)
        except Exception as error:
            failed, self._failures = 1, {max(int(about.current[0]), 0): f"{type(error).__name__}: {error}"}
        self.board.tells[:] = failed, about.pending[0], core_now()

    def _stepped(self, clock: NDArray[np.float64]) -> int:
        clock[:] = self.board.told[:2]
        give_inputs(self._arrays, self.board.inputs)
        self._failures = self._local.advance(self._arrays, *clock.tolist())
        return len(self._failures)

    def failures(self) -> list[tuple[int, str]]:
        """Return the failure of each plant that has failed in the last step."""
        return list((self._failures or self._local.failures()).items())

    def change(self, index: int, values: Any) -> None:
        """Give parameters of a plant other values; see `LocalPlants.change`."""
        self._local.change(index, values_from(values))

    def saved(self, index: int) -> dict[str, Any]:
        """Return the state of a plant; see `LocalPlants.saved`."""
        return self._local.saved(index).to_json()

    def restore(self, index: int, state: Any) -> None:
        """Let a plant go on from a saved state; see `LocalPlants.restore`."""
        self._local.restore(index, PlantState.from_json(state))

    def messages(self) -> list[object]:
        """Take the messages of all plants."""
        return [
            (index, said, [(one.status, one.category, one.text, one.count) for one in data])
            for index, said, data in self._local.messages()
            if said or data
        ]

    def close(self) -> None:
        """End the plants."""
        self._local.close()


def _specs(about: dict[str, Any]) -> list[PlantSpec]:
    return [PlantSpec.from_json(text) for text in about["specs"]]


@compiled
def serve(bell: NDArray[np.void], told: NDArray[np.float64], tells: NDArray[np.int64], plants: CompiledFleet) -> None:
    """Take steps when the harness rings, until it asks for something else.

    Parameters
    ----------
    bell
        The record of this process: its ``replies`` are what it reads, its ``requests`` what it writes. In the end
        ``answer`` has the beginning of a request, and ``heard`` its number of bytes.
    told, tells
        Those of the board.
    plants
        A step of the plants.
    """
    own = bell[0]
    own["slept"] = 1  # the harness still rings through the pipe alone
    while True:
        if not look_for_it(own):
            own["answer"] = 0
            own["heard"] = exchange(own["read"], (np.int32(own["replies"]), own["answer_at"], SIZE))
            if own["heard"] != SIZE or own["answer"] != STEP:
                swap(own["hears_at"] + SAYS, BY_PIPE)
                return
            swap(own["hears_at"] + SAYS, AWAKE)  # also if Python has rung
        own["seen"], own["slept"] = load(own["hears_at"]), 0
        plants.clock[0], plants.clock[1] = told[0], told[1]
        failed = call_bound(plants.call[0], plants.call[1], plants.call[2]) != 0 or plants.found[0] != 0
        own["core"] = core_of(own["core_now"], (np.int32(0),)) if own["core_now"] != 0 else -1
        own["other_core"] = told.view(np.int64)[2]
        tells[0], tells[1], tells[2] = failed, plants.said[0], own["core"]
        ring_there(own)
