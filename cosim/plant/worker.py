"""The process of its own in which a plant runs: ``python -m cosim.plant.worker``, started by `cosim.plant.process`.

Requests come through standard input and replies go out through standard output, both moved out of the FMU's reach
first: the FMU's own output goes to standard error.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
import traceback
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim import process_tree
from cosim.plant.failures import FINE, PlantError
from cosim.plant.foreign_modules import make_room
from cosim.plant.instance import Instance
from cosim.plant.log import Log
from cosim.plant.message import Message
from cosim.plant.protocol import HEADER, MAX_SAID, MAX_TEXT, Reply, Request, exactly, send
from cosim.plant.spec import PlantSpec, Value, values_from
from cosim.plant.stepping import Rows, advance, read_outputs
from cosim.plant.stepwise import StepwisePlant, stepper

_ORPHAN_CHECK = 1.0
"""Interval [s] of the check that the harness still runs."""


class LocalPlant:
    """A plant that compiled code can step, stepped here.

    Raises
    ------
    PlantError
        See `cosim.plant.instance.Instance`.
    """

    def __init__(self, spec: PlantSpec) -> None:
        self._instance = Instance(spec)
        try:
            self._rows = Rows([self._instance], [(len(spec.inputs.start), len(spec.outputs.start))])
            if not spec.late_outputs:
                self._check(*read_outputs(self._rows.rows[0]), subject="it ")
        except BaseException:
            self.close()
            raise
        self.first_outputs = self._rows.outputs.tolist()

    def begin(self, time: float, step: float, inputs: NDArray[np.float64]) -> None:
        """Give the inputs."""
        if (self._rows.inputs != inputs).any():
            self._rows.inputs[:] = inputs
            self._rows.rows["in_changed"] = True
        self._pending = (time, step)

    def finish(self, outputs: NDArray[np.float64]) -> None:
        """Take the step and write the outputs.

        Raises
        ------
        PlantError
            The FMU failed.
        """
        rows = self._rows
        self._check(*advance(rows.rows[0], rows.scratch[0], rows.work, *self._pending))
        outputs[:] = rows.outputs

    def change(self, values: Sequence[Value]) -> None:
        """See `Instance.change`."""
        self._instance.change(values)
        self._rows.rows["next_event"] = self._instance.next_event

    def take_messages(self) -> str:
        """Return the FMU's messages since the last call."""
        return self._instance.log.take()

    def take_data(self) -> list[Message]:
        """See `Log.take_data`."""
        return self._instance.log.take_data()

    def close(self) -> None:
        """End the plant."""
        self._instance.close()

    def _check(self, what: int, status: int, subject: str = "") -> None:
        if what != FINE:
            raise PlantError(subject + self._instance.failure(what, status))


def start(spec: PlantSpec) -> StepwisePlant:
    """Return a plant in this process.

    Raises
    ------
    PlantError
        See `cosim.plant.instance.Instance`.
    """
    plant = stepper(spec) or LocalPlant
    make_room(Path(spec.directory, "resources"))  # from now on imports may find modules of the FMU
    return plant(spec)


def main() -> None:
    """Serve one plant until the harness asks for its end, or has ended itself.

    The arguments are the harness's process, and the folders where its Python finds modules.
    """
    process_tree.adopt()
    sys.path += [folder for folder in sys.argv[2:] if folder not in sys.path]
    replies = _Replies()
    if os.name == "posix":
        threading.Thread(target=_end_with, args=(int(sys.argv[1]),), daemon=True).start()
    status = 0
    try:
        _serve(_out_of_reach(0), replies)
    except BaseException:
        traceback.print_exc()
        status = 1
    os._exit(status)  # without the FMU's exit handlers


class _Replies:
    """The pipe to the harness: replies, and before them the FMU's messages, from any thread."""

    def __init__(self) -> None:
        self._pipe = _out_of_reach(1)
        self._lock = threading.Lock()
        self._said = 0
        Log.listener = self._tell

    def send(self, kind: Reply, numbers: bytes, text: str) -> None:
        """Reply to a request."""
        self._said = 0
        with self._lock:
            send(self._pipe, kind, numbers + text.encode("utf-8", "replace")[:MAX_TEXT])

    def _tell(self, message: Message) -> None:
        self._said += 1
        if self._said <= MAX_SAID:
            with self._lock:
                send(self._pipe, Reply.SAID, message.to_bytes())


def _out_of_reach(descriptor: int) -> int:
    """Return another descriptor of a pipe, and let the one that the FMU knows lead to standard error, or nowhere."""
    if os.name == "posix":
        import fcntl

        other = fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, 10)
    else:
        other = os.dup(descriptor)
    os.dup2(2 if descriptor == 1 else os.open(os.devnull, os.O_RDWR), descriptor)
    return other


def _serve(requests: int, replies: _Replies) -> None:
    plant: StepwisePlant | None = None
    outputs = np.zeros(0)
    replies.send(Reply.DONE, b"", "")
    while (request := _receive(requests)) is not None:
        kind, body = request
        numbers = b""
        try:
            if kind == Request.START:
                spec = PlantSpec.from_json(body)
                plant = start(spec)
                outputs = np.array(plant.first_outputs, dtype=np.float64)
                numbers = outputs.tobytes()
            elif plant is None:
                pass
            elif kind == Request.STEP:
                given = np.frombuffer(body, dtype=np.float64)
                plant.begin(float(given[0]), float(given[1]), given[2:])
                plant.finish(outputs)
                numbers = outputs.tobytes()
            elif kind == Request.CHANGE:
                plant.change(values_from(json.loads(body)))
            elif kind == Request.END:
                plant.close()
        except PlantError as error:
            replies.send(Reply.FAILED, b"", str(error))
        except Exception as error:
            replies.send(Reply.FAILED, b"", f"{type(error).__name__}: {error}")
        else:
            replies.send(Reply.DONE, numbers, plant.take_messages() if plant is not None else "")


def _receive(pipe: int) -> tuple[int, bytes] | None:
    """Return the next request, None at the end."""
    header = exactly(pipe, HEADER.size)
    if header is None:
        return None
    kind, length = HEADER.unpack(header)
    body = exactly(pipe, length)
    return None if body is None else (kind, body)


def _end_with(parent: int) -> None:
    """End this process when the harness has ended, even while the FMU works, and what the FMU has started."""
    while os.getppid() == parent:
        time.sleep(_ORPHAN_CHECK)
    process_tree.end_descendants(os.getpid())
    os._exit(1)


if __name__ == "__main__":
    main()
