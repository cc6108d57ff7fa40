"""The process of their own in which plants run: ``python -m cosim.plant.worker``, started by `cosim.plant.process`.

Requests come through standard input and replies go out through standard output, both moved out of the FMUs' reach
first: the FMUs' own output goes to standard error, from where the harness takes it.
"""

from __future__ import annotations

import json
import os
import sys
import traceback
from collections.abc import Callable

from cosim import process_tree
from cosim.plant.failures import NoInstance, PlantError
from cosim.plant.local import NotStarted
from cosim.plant.printed import line_by_line
from cosim.plant.protocol import HEADER, Reply, Request, exactly, out_of_reach, send
from cosim.plant.serving import Served
from cosim.undisturbed import stay_deaf


def main() -> None:
    """Serve plants until the harness asks for their end, or has ended itself.

    The arguments are the harness's process, and the folders where its Python finds modules.
    """
    process_tree.leave_terminal()
    process_tree.adopt()
    sys.path += [folder for folder in sys.argv[2:] if folder not in sys.path]
    replies = out_of_reach(1)
    line_by_line()
    stay_deaf()
    process_tree.end_with(int(sys.argv[1]))
    status = 0
    try:
        _serve(out_of_reach(0), replies)
    except BaseException:
        traceback.print_exc()
        status = 1
    os._exit(status)  # without the FMU's exit handlers


def _serve(requests: int, replies: int) -> None:
    if (first := _receive(requests)) is None:
        return
    served = Served(json.loads(first[1]), requests, replies)
    send(replies, Reply.DONE)
    answer = _not_started(served, served.start)
    _answer(replies, Reply.DONE, answer)
    ready = answer is None
    while (request := _receive(requests, served.serve() if ready else b"")) is not None:
        kind, body = request
        try:
            if kind == Request.STEP:
                served.step()
                send(replies, Reply.DONE)
            else:
                ready = ready and kind != Request.END
                _answer(replies, Reply.DONE, _asked(served, kind, body))
        except PlantError as error:
            _answer(replies, Reply.FAILED, str(error))
        except Exception as error:
            _answer(replies, Reply.FAILED, f"{type(error).__name__}: {error}")


def _not_started(served: Served, start: Callable[[], None]) -> tuple[int, str, bool] | None:
    """Start the plants; return which one has failed, how, and whether it has given no instance; None if none has."""
    try:
        start()
    except NotStarted as error:
        return error.index, str(error), isinstance(error.error, NoInstance)
    except Exception as error:
        return max(int(served.board.activity.current[0]), 0), f"{type(error).__name__}: {error}", False
    return None


def _asked(served: Served, kind: int, body: bytes) -> object:
    if kind == Request.CHANGE:
        served.change(*json.loads(body))
    elif kind == Request.SAVE:
        return served.saved(*json.loads(body))
    elif kind == Request.RESTORE:
        served.restore(*json.loads(body))
    elif kind == Request.FAILURES:
        return served.failures()
    elif kind == Request.MESSAGES:
        return served.messages()
    elif kind == Request.RESTART:
        return _not_started(served, lambda: served.restart(json.loads(body)))
    elif kind == Request.END:
        served.close()
    return None


def _answer(pipe: int, kind: Reply, told: object) -> None:
    send(pipe, kind, b"" if told is None else json.dumps(told).encode())


def _receive(pipe: int, begun: bytes = b"") -> tuple[int, bytes] | None:
    """Return the next request, of which a part may have been read; None at the end."""
    rest = exactly(pipe, HEADER.size - len(begun))
    if rest is None:
        return None
    kind, length = HEADER.unpack(begun + rest)
    body = exactly(pipe, length)
    return None if body is None else (kind, body)


if __name__ == "__main__":
    main()
