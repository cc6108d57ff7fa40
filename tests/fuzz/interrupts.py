"""Ctrl-C before a line of a run, whichever it is: the run ends as it must, and nothing is left behind."""

from __future__ import annotations

import dis
import gc
import os
import random
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Any

import cosim
from cosim.errors import FormationError
from tests.fuzz import calls

PLANTS = ("", 'isolate="process"', 'isolate="no"', 'model="car_like"')
_ROOMS = ("/cosim/", "/plants/", "/controllers/")
_LIBRARIES = ("contextlib.py", "subprocess.py")
"""Modules of Python that hold what has been made and not yet handed over."""
_lines: dict[str, int] = {}
"""How many lines a run has, by its plants."""


def interrupts_case(seed: int, folder: Path, _: tuple[bytes, ...]) -> None:
    """Run a scenario, with Ctrl-C before one of its lines; raise what is left of it."""
    rng = random.Random(seed)
    plants = rng.choice(PLANTS)
    if plants not in _lines:
        _run(plants, folder, 0, [])  # imports
        _lines[plants] = _run(plants, folder, 0, [])
    line = rng.randint(1, _lines[plants])
    before = calls._held()
    struck: list[str] = []
    with suppress(KeyboardInterrupt, FormationError):
        _run(plants, folder, line, struck)
    gc.collect()  # what was just being handed over ends with the object that has it
    if (held := calls._held()) != before:
        raise AssertionError(f"{plants}: line {line}, {' < '.join(struck)}: {before} to {held}")


def _run(plants: str, folder: Path, line: int, struck: list[str]) -> int:
    """Run with Ctrl-C before a line or the next one that a signal can strike, and tell where; before none if it is 0.

    Return how many lines there were.
    """
    lines, process = 0, os.getpid()  # a process that is forked for the run goes on undisturbed

    def trace(frame: FrameType, event: str, _: Any) -> Callable[..., Any] | None:
        nonlocal lines
        if (event == "call" and not _watched(frame.f_code.co_filename)) or os.getpid() != process:
            return None
        if event == "line":
            lines += 1
            if 0 < line <= lines and not _ends_handling(frame):
                sys.settrace(None)
                struck.extend(_stack(frame))
                signal.raise_signal(signal.SIGINT)
        return trace

    fmu = "" if "model" in plants else f'fmu="{calls._fmu(folder, name="good", **calls.GOOD)}"'
    path = calls.scenario(folder / "interrupted.xml", f'<plant id="car" {fmu} {plants}/>', horizon="0.2 s")
    sys.settrace(trace)
    try:
        cosim.run(path)
    finally:
        sys.settrace(None)
    return lines


def _watched(file: str) -> bool:
    return any(room in file for room in _ROOMS) or file.endswith(_LIBRARIES)


def _ends_handling(frame: FrameType) -> bool:
    """Return whether a line, such as ``return False`` of an ``except``, begins with the end of handling an exception.

    No signal strikes there: Python looks for them at calls and jumps back. If a trace function raises there, Python
    3.11 to 3.13 keep the handled exception for ever, with all frames that it has passed.
    """
    return dis.opname[frame.f_code.co_code[frame.f_lasti]] == "POP_EXCEPT"


def _stack(frame: FrameType | None) -> list[str]:
    found: list[str] = []
    while frame is not None and len(found) < 6:
        found.append(f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}")
        frame = frame.f_back
    return found
