"""Small studies for tests: their file, and an executor that plays their runs."""

import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import pytest

from cosim.scenario.grammar import NAMESPACE
from cosim.studies import making
from cosim.studies.plan import Run
from cosim.studies.reader import read_study
from cosim.studies.row import Row
from cosim.studies.study import Study
from cosim.studies.task import Task

EXAMPLE = Path(__file__).with_name("example.xml")
MASS = "plant/parameter[@name='m_c']/@value"
UNIFORM = f'<vary name="mass" select="{MASS}"><uniform from="25 kg" to="40000 g"/></vary>'
SEEDS = '<vary name="seed" select="simulation/@seed"><count from="7"/></vary>'
LAST = '<measure name="last" figure="final" signal="range_error" unit="mm"/>'


def write_study(
    folder: Path, vary: str = UNIFORM + SEEDS, sample: str = '<sample method="random" runs="6"/>', rest: str = LAST
) -> Path:
    """Write a study of a scenario of ten ticks, which passes."""
    base = EXAMPLE.read_text(encoding="utf-8").replace('"100 s"', '"0.2 s"')
    expect = '<expect><final signal="range_error" below="99 m"/></expect></scenario>'
    (folder / "base.xml").write_text(base.replace("</scenario>", expect), encoding="utf-8")
    path = folder / "study.xml"
    path.write_text(
        f'<study xmlns="{NAMESPACE}" name="small" of="base.xml">\n<title>A small study</title>\n'
        f"{vary}\n{sample}\n{rest}\n</study>\n",
        encoding="utf-8",
    )
    return path


def small_study(folder: Path, *parts: str, **named: str) -> Study:
    """Write a study and read it; see `write_study`."""
    return read_study(write_study(folder, *parts, **named))


class Played(Executor):
    """Makes rows by a function of the run in place of a simulation; from here on, of all studies of a test."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, play: Callable[[Run, str], Row]) -> None:
        self._play = play
        self.runs = 0
        monkeypatch.setattr(making, "rows_of", self._rows)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Return a future with the rows of a task."""
        _, task = args
        future: Future[Any] = Future()
        future.set_result((list(self._rows(pickle.loads(task))), 0.01))
        return future

    def _rows(self, task: Task) -> Iterator[Row]:
        for run, key in zip(task.runs, task.keys, strict=True):
            self.runs += 1
            yield self._play(run, key)
