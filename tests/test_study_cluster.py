"""Studies on a cluster that Dask leads: the rows are those of processes here, whatever is killed meanwhile."""

import re
import socket
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

from cosim.cli import main
from cosim.errors import InputError
from cosim.studies import cluster, elsewhere
from cosim.studies.conduct import conduct
from cosim.studies.reader import read_study
from cosim.studies.row import BROKEN, PASSED, Row
from cosim.tests.studies import small_study, write_study
from cosim.unforeseen import Lack

from .crashing_study import crashing_study
from .dask_cluster import Cluster
from .environments import distribution
from .test_own_law import LAW

pytest.importorskip("distributed")
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="processes are killed by signals")
MANY = '<sample method="random" runs="40"/>'


@pytest.fixture(scope="module")
def two_workers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    led = Cluster(tmp_path_factory.mktemp("dask"))
    try:
        led.add_worker()
        led.add_worker()
        yield led
    finally:
        led.close()


def test_an_fmu_that_crashes_costs_its_run_and_no_worker(tmp_path: Path, two_workers: Cluster) -> None:
    study = crashing_study(tmp_path, "9 s, 0.2 s, 8 s")
    outcome = conduct(study, tmp_path, scheduler=two_workers.address)
    assert [row.status for row in outcome.rows] == [PASSED, BROKEN, PASSED]
    assert re.search("leader at t = 0.2 s: the plant car.fmu did not complete the step", outcome.rows[1].message)
    assert [worker.poll() for worker in two_workers.workers] == [None, None]


def test_workers_and_schedulers_that_are_killed_cost_nothing(tmp_path: Path, two_workers: Cluster) -> None:
    study = small_study(tmp_path, sample=MANY)
    for name in ("here", "there"):
        (tmp_path / name).mkdir()
    expected = conduct(study, tmp_path / "here", workers=0).rows
    killed: list[int] = []

    def conducted(kill: Callable[[], object], runs: int) -> tuple[Row, ...]:
        def look(rows: Sequence[Row], left: int) -> None:
            if rows and left < runs - 2 and runs not in killed:
                killed.append(runs)
                kill()

        return conduct(study, tmp_path / "there", scheduler=two_workers.address, runs=runs, progress=look).rows

    assert conducted(two_workers.kill_worker, 20) == expected[:20]
    with pytest.raises(Lack, match="the runs so far are kept, and the same command goes on"):
        conducted(two_workers.scheduler.kill, 40)
    last = conduct(study, tmp_path / "there", workers=0)
    assert (killed, last.rows, last.made < 20) == ([20, 40], expected, True)


def test_another_version_on_a_worker_is_refused(tmp_path: Path) -> None:
    about = tmp_path / "formation_cosim-9.9.dist-info" / "METADATA"
    about.parent.mkdir()
    about.write_text("Metadata-Version: 2.1\nName: formation-cosim\nVersion: 9.9\n")
    led = Cluster(tmp_path)
    try:
        led.add_worker(str(tmp_path))
        with pytest.raises(InputError, match=r"worker on .* has formation-cosim 9.9, where this command has .* 0\."):
            conduct(small_study(tmp_path), tmp_path, scheduler=led.address)
    finally:
        led.close()
    with pytest.raises(InputError, match=r"has Python 3\.\d+, where this command has Python 2\.7"):
        elsewhere.make({"Python": "2.7"}, b"")
    with pytest.raises(InputError, match=r"has no dask-of-old, where this command has dask-of-old 1"):
        elsewhere.make({"dask-of-old": "1"}, b"")


def test_another_law_on_a_worker_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It has the same name, package and version."""
    for place, text in (("here", LAW), ("there", LAW.replace("np.zeros", "np.ones"))):
        distribution(tmp_path / place, "my-law", "1.0", ["mine = my_law:MyLaw"], text)
    monkeypatch.syspath_prepend(str(tmp_path / "here"))
    path = write_study(tmp_path)
    base = tmp_path / "base.xml"
    law = '<controller id="pid" name="mine" package="my-law" version="==1.0"/>'
    base.write_text(re.sub("(?s)<controller.*?</controller>", law, base.read_text("utf-8")), "utf-8")
    led = Cluster(tmp_path)
    try:
        led.add_worker(str(tmp_path / "there"))
        with pytest.raises(
            InputError, match=r"the worker on .* has my-law 1\.0 \(files .*command has my-law 1\.0 \(files"
        ):
            conduct(read_study(path), tmp_path, scheduler=led.address)
    finally:
        led.close()
        sys.modules.pop("my_law", None)


def test_a_scheduler_that_is_not_there_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cluster, "_ANSWER", 0.2)
    path = write_study(tmp_path)
    with socket.create_server(("127.0.0.1", 0)) as deaf:
        port = deaf.getsockname()[1]
        for address in (f"tcp://127.0.0.1:{port}", "nonsense"):
            assert main(["study", str(path), "--out", str(tmp_path), "--scheduler", address]) == 2
            assert f"no scheduler of Dask answers at {address!r}" in capsys.readouterr().err
    assert main(["study", str(path), "--out", str(tmp_path), "--scheduler", f"tcp://127.0.0.1:{port}"]) == 2
    assert "`dask scheduler` prints its address" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(["study", str(path), "--out", str(tmp_path), "--scheduler", "tcp://127.0.0.1:1"]) == 2
    assert "pip install 'formation-cosim[cluster]'" in capsys.readouterr().err
