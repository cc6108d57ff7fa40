"""A process that makes runs: ``python -m cosim.studies.worker``, started by `cosim.studies.worker_process`.

Tasks come through standard input. What goes out through standard output are frames of `cosim.plant.protocol`: that a
task has begun, an answer after each run, such as its row, and that the task is done. It ends if there is nothing to do
for a while.
"""

from __future__ import annotations

import faulthandler
import json
import os
import pickle
import sys
import threading
import time
import traceback
from collections.abc import Iterator
from enum import IntEnum
from typing import TypeVar

from cosim import process_tree
from cosim.errors import InputError
from cosim.plant.protocol import exactly, out_of_reach, send
from cosim.undisturbed import stay_deaf
from cosim.unforeseen import foreseen, lack_of

LENGTH = 8
"""Bytes of the length of a task, before it."""
_IDLE = 60.0
"""Time [s] without a task after which it ends."""
_SLOW = 20.0
"""How many times longer than a usual run one may take before the process ends itself."""
_LEAST_LIMIT = 60.0
"""The least limit of time [s] for a run."""
_T = TypeVar("_T")


class Told(IntEnum):
    """Kinds of frames: a task has begun, an answer, it is done with the time that it took, or an error has ended it.

    Such an error is a lack of the machine, or of the code that is wanted, or nobody foresaw it.
    """

    BEGUN, ANSWER, DONE, UNFORESEEN = range(4)


def main() -> None:
    """Make the runs of one task after the other, until there are no more, or the process that started this one ends.

    The arguments are that process, and the folders where its Python finds modules.
    """
    process_tree.leave_terminal()
    process_tree.adopt()
    sys.path += [folder for folder in sys.argv[2:] if folder not in sys.path]
    answers, tasks = out_of_reach(1), out_of_reach(0)
    process_tree.end_with(int(sys.argv[1]))
    stay_deaf()
    try:
        from cosim.studies.task import close_all  # and with it all that a run needs

        while (data := _next(tasks)) is not None:
            send(answers, Told.BEGUN)
            began = time.perf_counter()
            task = pickle.loads(data)  # from the process that has started this one
            for answer in _within(_LEAST_LIMIT + _SLOW * task.usual, task.answers()):
                send(answers, Told.ANSWER, answer.encode())
            send(answers, Told.DONE, json.dumps(time.perf_counter() - began).encode())
        close_all()
    except BaseException as error:
        lacks = bool(lack_of(error))
        message = str(foreseen(error)) if lacks else f"{type(error).__name__}: {error}"
        refuses = not lacks and isinstance(error, InputError)
        message = str(error) if refuses else message
        told = {"lacks": lacks, "refuses": refuses, "message": message, "traceback": traceback.format_exc()}
        send(answers, Told.UNFORESEEN, json.dumps(told).encode())
    os._exit(0)  # without the FMUs' exit handlers


def _within(limit: float, items: Iterator[_T]) -> Iterator[_T]:
    """Return items as they come; end this process if one takes longer than a limit [s]."""
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        while True:
            # an FMU that hangs holds Python's lock, but not this watch's thread
            faulthandler.dump_traceback_later(limit, exit=True, file=nowhere)
            item = next(items, None)
            faulthandler.cancel_dump_traceback_later()
            if item is None:
                return
            yield item


def _next(tasks: int) -> bytes | None:
    """Return the next task; None if there are no more."""
    alarm = threading.Timer(_IDLE, os._exit, [0])
    alarm.daemon = True
    alarm.start()
    length = exactly(tasks, LENGTH)
    alarm.cancel()
    return None if length is None else exactly(tasks, int.from_bytes(length, "little"))


if __name__ == "__main__":
    main()
