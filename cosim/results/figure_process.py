"""Figures drawn in a process of their own, beside whatever else a command does; that process alone loads Matplotlib."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from cosim.closing import Closing
from cosim.results.representative import representative
from cosim.results.result import Result
from cosim.undisturbed import deaf

PROGRAM = "import sys; sys.path[:] = sys.argv[1:]; from cosim.results.figure_process import serve; serve()"
"""The program of the process, which finds modules where this process finds them."""


class FigureProcess(Closing):
    """Draws one figure at a time. Its process lasts for all figures of a command, as Matplotlib is slow to import.

    Legal call order: `start` if there is time to load before the first figure; `draw`, then `wait`, as often as wanted.
    At the end of its ``with`` block a figure that nobody has waited for is given up.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._sending: threading.Thread | None = None
        self._fault = ""

    def start(self) -> None:
        """Start the process, if it does not run."""
        if self._process is not None and self._process.poll() is None:
            return
        self.close()
        self._fault = ""
        options: dict[str, Any] = (
            {"start_new_session": True}  # Ctrl-C is the command's
            if os.name == "posix"
            else {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}  # type: ignore[attr-defined]
        )
        command = [sys.executable, "-P", "-c", PROGRAM, *(os.path.abspath(folder) for folder in sys.path)]
        try:
            with deaf():
                self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, **options)
        except OSError as error:
            self._fault = f"its process cannot be started: {error.strerror}"

    def draw(self, result: Result, path: Path) -> None:
        """Begin to draw a result into a PNG file, whose path is absolute."""
        self.start()
        if self._process is not None:
            sending = threading.Thread(target=_send, args=(self._process.stdin, result, str(path)), daemon=True)
            try:
                sending.start()
            except RuntimeError as error:
                self.close()
                self._fault = f"its process cannot be used: {error}"
            else:
                self._sending = sending

    def wait(self) -> str:
        """Wait for the figure; return why it could not be drawn, or nothing if it is."""
        if self._process is None:
            return self._fault
        assert self._process.stdout is not None
        reply = self._process.stdout.readline()
        if not reply:
            return f"its process ended with status {self._process.wait()}"
        if self._sending is not None:
            self._sending.join()
            self._sending = None
        fault: str = json.loads(reply)
        return fault

    def close(self) -> None:
        """End the process at once: nobody waits for a figure that it draws."""
        process, self._process = self._process, None
        if process is None:
            return
        assert process.stdin is not None
        assert process.stdout is not None
        process.kill()
        if self._sending is not None:
            self._sending.join()
            self._sending = None
        with suppress(OSError):
            process.stdin.close()
        process.wait()
        process.stdout.close()


def _send(pipe: IO[bytes], result: Result, path: str) -> None:
    try:
        pickle.dump((representative(result), path), pipe, pickle.HIGHEST_PROTOCOL)
        pipe.flush()
    except Exception:  # waiting for the reply finds out that the process has ended, as it does at the end of its input
        with suppress(OSError):
            pipe.close()


def serve() -> None:
    """Draw figures as they are asked for at standard input, until it ends; reply with the fault of each, or nothing.

    What a library prints goes nowhere: standard output is for the replies.
    """
    replies = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    _fault_of_import()
    while True:
        try:
            result, path = pickle.load(sys.stdin.buffer)
        except (EOFError, pickle.UnpicklingError):
            break
        replies.write(json.dumps(_fault_of_import() or _fault(result, Path(path))) + "\n")
        replies.flush()
    os._exit(0)  # without taking Matplotlib apart


def _fault_of_import() -> str:
    try:
        import cosim.results.figure  # noqa: F401
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return ""


def _fault(result: Result, path: Path) -> str:
    from cosim.results.figure import save_figure

    try:
        save_figure(result, path)
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return ""
