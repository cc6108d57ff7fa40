"""A scheduler of Dask and its workers, for tests that kill them."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

_KNOWN = "Registered to:"
"""What a worker logs once the scheduler knows it; on a busy machine its start takes longer than a study waits."""


class Cluster:
    """A scheduler and its workers, each started as a user does it."""

    def __init__(self, folder: Path, **environment: str) -> None:
        self._folder, self._environment = folder, environment
        self._log = folder / "log"
        self.workers: list[subprocess.Popen[bytes]] = []
        about = folder / "scheduler.json"
        about.unlink(missing_ok=True)
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(about))
        _wait_for(lambda: about.exists() and about.read_text().endswith("}"))
        self.address = json.loads(about.read_text())["address"]

    def add_worker(self, path: str = "") -> None:
        options = ("--nthreads", "1", "--no-nanny", "--local-directory", str(self._folder))
        known = self._log.read_text().count(_KNOWN)
        self.workers.append(self._start("worker", self.address, *options, path=path))
        _wait_for(lambda: self._log.read_text().count(_KNOWN) > known)

    def kill_worker(self) -> None:
        killed = self.workers.pop(0)
        killed.kill()
        killed.wait()

    def close(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()

    def _start(self, *options: str, path: str = "") -> subprocess.Popen[bytes]:
        with self._log.open("ab") as log:
            command = [sys.executable, "-m", "dask", *options, "--no-dashboard"]
            environment = {**os.environ, "PYTHONPATH": path, **self._environment}
            return subprocess.Popen(command, stdout=log, stderr=log, env=environment)


def _wait_for(condition: Callable[[], bool]) -> None:
    give_up = time.monotonic() + 120
    while not condition():
        assert time.monotonic() < give_up
        time.sleep(0.02)
