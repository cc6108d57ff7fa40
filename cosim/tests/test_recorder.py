"""Where the records of a run lie, and what is computed of them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.master.recorder import Recorder


def room_of(recorded: int, memory: list[NDArray[Any]] | None) -> NDArray[np.float64]:
    recorder = Recorder(5, [], memory=memory)
    recorder.recorded = recorded
    return recorder.room_for((2, 3))


def test_what_is_computed_lies_in_the_memory_of_the_run_before() -> None:
    memory: list[NDArray[Any]] = []
    whole, ended_early = room_of(5, memory), room_of(2, memory)
    assert (whole.shape, ended_early.shape) == ((2, 3, 5), (2, 3, 2))
    assert whole.flags.c_contiguous
    assert ended_early.flags.c_contiguous
    assert np.shares_memory(whole, ended_early)
    assert not np.shares_memory(room_of(5, None), room_of(5, None))
