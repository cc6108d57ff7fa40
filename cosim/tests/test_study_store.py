"""The rows of a study on disk: kept whatever happens, and never taken for those of another one."""

import json
import math
import shutil
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from contextlib import closing
from dataclasses import replace
from itertools import islice
from pathlib import Path

import pytest

from cosim.errors import InputError, OutputError
from cosim.studies import worker_process
from cosim.studies.conduct import check_study
from cosim.studies.crew import Crew
from cosim.studies.crews import crew_of
from cosim.studies.engine import Workers
from cosim.studies.making import Maker
from cosim.studies.plan import Plan, Run
from cosim.studies.row import Row
from cosim.studies.store import FILE, Store
from cosim.studies.task import Task
from cosim.studies.worker_process import Ended, Processes, WorkerProcess
from cosim.tests.studies import small_study


def row(number: int) -> Row:
    return Row(
        key=f"key {number}",
        number=number,
        draw=number,
        values=("1 kg", None),
        status="passed",
        measures=(0.1 + number, math.inf, math.nan),
        margins=(-math.inf,),
        message="",
    )


def same(one: Row, other: Row) -> bool:
    return repr(one) == repr(other)  # NaN is not equal to itself


def test_rows_are_read_again_to_the_bit(tmp_path: Path) -> None:
    with Store(tmp_path, "mine") as store:
        store.append([row(1), row(2)])
        store.append([row(3)])
    with Store(tmp_path, "mine") as again:
        assert [same(again.rows[f"key {n}"], row(n)) for n in (1, 2, 3)] == [True] * 3
        assert again.unreadable == 0


def test_a_line_that_was_cut_off_is_removed_and_the_rest_kept(tmp_path: Path) -> None:
    with Store(tmp_path, "mine") as store:
        store.append([row(1), row(2)])
    whole = (tmp_path / FILE).read_bytes()
    end_of_first = whole.rindex(b"\n", 0, -1) + 1
    for cut in range(1, len(whole), 7):
        (tmp_path / FILE).write_bytes(whole[:cut])
        with Store(tmp_path, "mine") as store:
            assert len(store.rows) == (cut >= end_of_first)
            store.append([row(5)])
        with Store(tmp_path, "mine") as store:
            assert "key 5" in store.rows
            assert store.unreadable == 0


def test_lines_that_are_no_rows_are_counted(tmp_path: Path) -> None:
    with Store(tmp_path, "mine") as store:
        store.append([row(1)])
    with (tmp_path / FILE).open("a") as file:
        file.write('nonsense\n{"key": 1}\n[]\n' + row(2).to_json().replace("passed", "fine") + "\n")
    with Store(tmp_path, "mine") as store:
        assert (list(store.rows), store.unreadable) == (["key 1"], 4)


@pytest.mark.parametrize(
    ("head", "said"),
    [
        ({"format": "formation-study-rows 1", "study": "other"}, "of the study 'other', not of 'mine'"),
        ({"format": "formation-study-rows 2", "study": "mine"}, "another version of Formation"),
        ({"some": "file"}, "does not hold the rows of a study"),
    ],
)
def test_rows_of_something_else_are_refused(tmp_path: Path, head: dict[str, str], said: str) -> None:
    (tmp_path / FILE).write_text(json.dumps(head) + "\n")
    with pytest.raises(InputError, match=said):
        Store(tmp_path, "mine")
    assert (tmp_path / FILE).read_text() == json.dumps(head) + "\n"


@pytest.mark.skipif(sys.platform == "win32", reason="nothing is locked there")
@pytest.mark.skipif(sys.platform == "win32", reason="a file that is open cannot be removed there")
def test_a_folder_that_somebody_removes_costs_no_course(tmp_path: Path) -> None:
    folder = tmp_path / "study"
    folder.mkdir()
    store = Store(folder, "small")
    with closing(store):
        kept = store.append([replace(row(number), courses=(f"course {number}",)) for number in range(3)])
        shutil.rmtree(folder)
        assert list(store.courses(kept)) == [("course 0",), ("course 1",), ("course 2",)]


def test_one_process_at_a_time(tmp_path: Path) -> None:
    with Store(tmp_path, "mine"), pytest.raises(InputError, match="in use by another command"):
        Store(tmp_path, "mine")
    with Store(tmp_path, "mine"):
        pass


def test_a_disk_that_is_full_loses_nothing_that_was_written(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    signal = pytest.importorskip("signal")
    with Store(tmp_path, "mine") as store:
        store.append([row(1)])
        size = (tmp_path / FILE).stat().st_size
        limits = resource.getrlimit(resource.RLIMIT_FSIZE)
        handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        try:
            resource.setrlimit(resource.RLIMIT_FSIZE, (size + 10, limits[1]))
            with pytest.raises(OutputError, match="cannot be written"):
                store.append([row(2)])
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
            signal.signal(signal.SIGXFSZ, handler)
        assert (tmp_path / FILE).stat().st_size == size
        store.append([row(3)])
    with Store(tmp_path, "mine") as again:
        assert list(again.rows) == ["key 1", "key 3"]


def test_a_search_asks_for_runs_when_it_has_the_rows_before(tmp_path: Path) -> None:
    study = small_study(tmp_path, sample='<sample method="random" runs="20"/>')
    plan, keys, _ = check_study(study)
    told: list[int] = []

    def ask(most: int) -> list[Run]:
        """Return the next run, if the last one is there: never two at a time."""
        if len(asked) > len(told) or len(asked) == 7:
            return []
        asked.append(plan[len(asked)])
        return asked[-1:]

    def take(rows: Sequence[Row]) -> bool:
        told.extend(row.number for row in rows)
        return True

    for made in (7, 0):
        asked: list[Run] = []
        told.clear()
        with Store(tmp_path, "small") as store, crew_of(workers=0) as crew:
            maker = Maker(study, keys, store, crew)
            maker.make(ask, take)
        assert (told, maker.made) == ([1, 2, 3, 4, 5, 6, 7], made)


@pytest.mark.parametrize("ended_after", [0, 2, 4])
def test_a_process_that_ends_in_a_chunk_costs_no_row(
    ended_after: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = small_study(tmp_path)
    tasks: list[Task] = []

    def answers(self: Processes, task: Task, read: object) -> Iterator[Row | float]:
        tasks.append(task)
        for index, run in enumerate(task.runs):
            if len(tasks) == 1 and index == ended_after:
                raise Ended
            yield row(run.number)
        if len(tasks) == 1:
            raise Ended
        yield 0.1

    monkeypatch.setattr(Processes, "answers", answers)
    runs = [(run, str(run.number)) for run in islice(Plan(study), 4)]
    made, _ = Processes().make(Workers(study, Crew(lambda task: Future(), lambda: 1), {}).task(runs))
    assert [one.number for one in made] == [1, 2, 3, 4]
    assert [(len(task.runs), task.alone) for task in tasks[1:2]] == [(1, True)] * (ended_after < 4)


@pytest.mark.parametrize(("ended", "fault"), [([1], False), ([1, 2, 3], True)], ids=["one", "all"])
def test_a_process_that_is_ended_while_it_starts_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ended: list[int], fault: bool
) -> None:
    started: list[WorkerProcess] = []

    class Short(WorkerProcess):
        def __init__(self) -> None:
            super().__init__()
            started.append(self)
            if len(started) in ended:
                self.end()

    monkeypatch.setattr(worker_process, "WorkerProcess", Short)
    study = small_study(tmp_path)
    task = Workers(study, Crew(lambda task: Future(), lambda: 1), {}).task([(Plan(study)[0], "key")])
    processes = Processes()
    try:
        if fault:
            with pytest.raises(RuntimeError, match="did not start: its process crashed"):
                processes.make(task)
        else:
            assert len(processes.make(task)[0]) == 1
    finally:
        processes.close()
