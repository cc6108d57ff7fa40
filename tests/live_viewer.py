"""A command with a live page, in a process of its own, and where its page is."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PROGRAM = "import sys; from cosim.cli import main; sys.exit(main(sys.argv[1:]))"


class LiveRun:
    """``formation run --live`` in a process of its own."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.log = folder / "log"
        self.out = folder
        command = [sys.executable, "-c", PROGRAM, "run", "--live", "--no-figure", "--out", str(folder), *arguments]
        with self.log.open("w") as log:
            self.process = subprocess.Popen(command, stdout=log, stderr=log, env={**os.environ, "DISPLAY": ""})

    @property
    def said(self) -> str:
        """What it has printed."""
        return self.log.read_text(encoding="utf-8")

    @property
    def address(self) -> str:
        """The address of the page, once it is printed."""
        deadline = time.monotonic() + 120.0
        while (found := re.search(r"live page: (http://\S+/)\n", self.said)) is None:
            assert self.process.poll() is None, self.said
            assert time.monotonic() < deadline
            time.sleep(0.02)
        return found[1]


@contextmanager
def live_run(folder: Path, *arguments: str) -> Iterator[LiveRun]:
    """Start the command, and end it at the end of the block if it goes on."""
    run = LiveRun(folder, *arguments)
    try:
        yield run
    finally:
        run.process.kill()
        run.process.wait(60)
