"""Kills commands and their processes at random moments: ``python -m tests.kills --count 1000 --seed 1`` from the root.

With ``--stop`` it sends SIGTERM, SIGINT or SIGHUP to all processes of a command, instead of killing one.

Commands are forked from a process that has imported everything, so that the moments fall into their work. After some
kills the command runs to its end, and its files, its status and what is left are checked. Exit status 1: a finding.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import secrets
import shutil
import signal
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import h5py
from lxml import etree

from cosim import process_tree
from cosim.cli import entry
from cosim.cli.earlier_results import BEFORE
from cosim.tests.driving import scenario
from cosim.tests.studies import SEEDS, write_study
from cosim.undisturbed import SIGNALS
from plants import scratch
from tests.dask_cluster import Cluster
from tests.environments import CONTROLLERS, environment
from tests.safety import passed
from tests.stub.stub import make_fmu

KINDS = ["run", "run", "figure", "build", "check", "pytest", "hosted", "study", "tune", "cluster", "hosted study"]
"""Commands, those twice that are given more often; those that are hosted have a law in an environment of its own."""
STUDIES = {"study": "study", "tune": "tune", "cluster": "study", "hosted study": "hosted"}
"""The file of each kind of study."""
HOSTED = ("hosted_built_in", "hosted_supervised")
"""Scenarios with a law in an environment of its own."""
KILLS = 4
"""Kills of a command before it runs to its end once."""
LAST_MOMENT = 20.0
"""Time [s] within which the processes of a killed command must have ended."""
MARK, CLUSTER_MARK = "FORMATION_KILLS", secrets.token_hex(8)
STATUSES = {0, 1, 2, 3, 70, 71, -signal.SIGKILL}
"""How a command may end of which some process was killed."""
STOPPED = {0, 130}
"""How a command may end that was stopped with all its processes."""
UNHEEDING = {"pytest", "cluster"}
"""Commands of others, and with processes of others."""


class Bench:
    """A folder with scenarios, and commands that run, check, build and test in it again and again."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        fmu = make_fmu(folder / "fmus", name="car")
        self.names = ("built_in", "supervised", "isolated")
        plants = ('model="car_like"', f'fmu="{fmu}"', f'fmu="{fmu}" isolate="process"')
        expect = '<expect><peak signal="pose" component="x" below="1 km"/></expect>'
        self.paths = [
            scenario(folder / "s" / f"{name}.xml", f'<plant id="car" {plant}/>', more=expect)
            for name, plant in zip(self.names, plants, strict=True)
        ]
        there = environment(folder / "environment", CONTROLLERS)
        hosted = self._hosted(there)
        self.out, self.outcomes = folder / "studies", dict[str, dict[str, bytes]]()
        self.cluster: Cluster | None = None
        for name in ("tmp", "cache", "study", "tune", "dask", "hosted"):
            (folder / name).mkdir()
        os.environ["TMPDIR"], os.environ["FORMATION_CACHE"] = str(folder / "tmp"), str(folder / "cache")
        tempfile.tempdir = None
        paths = [str(path) for path in self.paths]
        to = [*paths, "--out", str(folder / "runs"), "--junit", str(folder / "all.xml")]
        self.commands = {
            "run": ["run", "--no-figure", *to],
            "figure": ["run", *to],
            "hosted": ["run", "--no-figure", *map(str, hosted), "--out", str(folder / "runs")],
            "check": ["check", *paths],
            "build": ["build", "car_like", "--out", str(folder / "built")],
            "study": ["study", str(_study(folder / "study")), "--workers", "2", *self._to("study")],
            "tune": ["study", str(_tuning(folder / "tune")), "--workers", "2", *self._to("tune")],
            "hosted study": [
                *("study", str(_inside(_study(folder / "hosted"), there)), "--workers", "2"),
                *self._to("hosted study"),
            ],
            "pytest": ["-q", "-p", "no:cacheprovider", "-p", "no:xdist", *paths],
        }

    def _hosted(self, there: Path) -> list[Path]:
        """Write scenarios with a law in an environment, beside a built-in plant and a supervised one."""
        made = []
        for path in self.paths[:2]:
            text = path.read_text("utf-8").replace("<controller ", f'<controller environment="{there}" ')
            made.append(path.with_name(f"hosted_{path.name}"))
            made[-1].write_text(text.replace(f'name="{path.stem}"', f'name="hosted_{path.stem}"'), "utf-8")
        return made

    def _to(self, kind: str) -> tuple[str, ...]:
        return "--no-figure", "--out", str(self.out / kind)

    def call(self, kind: str) -> None:
        """Give a command, in this process; that of a cluster in place of it, as its client has threads."""
        if kind == "pytest":
            import pytest

            sys.exit(pytest.main(self.commands[kind]))
        if self.cluster is not None and kind == "cluster":
            study = ["study", self.commands["study"][1], "--scheduler", self.cluster.address, *self._to("cluster")]
            os.execv(sys.executable, [sys.executable, "-m", "cosim", *study])
        sys.argv[1:] = self.commands[kind]
        entry()

    def start(self, kind: str) -> tuple[int, str]:
        """Start a command in a process of its own; return that with the mark of all that it starts."""
        mark = secrets.token_hex(8)
        if (pid := os.fork()) == 0:
            status = 70
            try:
                scratch._remove_left.cache_clear()  # as in a process that has only begun
                os.environ[MARK] = mark
                with (self.folder / "log").open("ab") as log:
                    os.dup2(log.fileno(), 1)
                    os.dup2(log.fileno(), 2)
                self.call(kind)
            except SystemExit as error:
                status = int(error.code or 0)
            finally:
                os._exit(status)
        return pid, mark

    def begin_anew(self, kind: str) -> None:
        """Forget what earlier commands of a kind have left, where the next one would go on from it."""
        shutil.rmtree(self.out / kind, ignore_errors=True)

    def outcome_differs(self, kind: str) -> bool:
        """Return whether the files of a study are other ones than the first."""
        folder = self.out / kind / "small"
        names = ("runs.csv", "summary.json", *["trials.csv", "tuned.xml"] * (kind == "tune"))
        outcome = {name: (folder / name).read_bytes() for name in names}
        return outcome != self.outcomes.setdefault(STUDIES[kind], outcome)

    def start_cluster(self) -> None:
        """Start a scheduler and two workers, or those that were killed."""
        if self.cluster is not None and self.cluster.scheduler.poll() is not None:
            self.end_cluster()
        if self.cluster is None:
            place = self.folder / "dask"  # its processes keep what they have prepared
            self.cluster = Cluster(place, **{MARK: CLUSTER_MARK, "TMPDIR": str(place)})
        self.cluster.workers = [worker for worker in self.cluster.workers if worker.poll() is None]
        while len(self.cluster.workers) < 2:
            self.cluster.add_worker()

    def end_cluster(self) -> None:
        """End the scheduler and its workers."""
        if self.cluster is not None:
            self.cluster.close()
            self.cluster = None

    # What must hold -----------------------------------------------------------------------------------------

    def findings(self) -> Iterator[str]:
        """Return what is wrong with the files: each is whole, and no summary is one of a run that did not end."""
        for pattern, read in READERS.items():
            for path in self.folder.glob(pattern):
                try:
                    read(path)
                except Exception as error:
                    yield f"{path} is not whole: {type(error).__name__}: {error}"
        for name in (*self.names, *HOSTED):
            folder = self.folder / "runs" / name
            if (folder / BEFORE).exists() and passed(folder):
                yield f"{folder} says that a run has passed, which did not end"

    def left(self) -> list[str]:
        """Return what is left after a command that ended by itself."""
        places = ("tmp/*", "runs/*/.*", "runs/*/*.before.nc", ".formation-*", "built/.*", "cache/**/.build-*")
        return [str(path) for place in places for path in self.folder.glob(place)]


def _study(folder: Path) -> Path:
    """Write a study of runs that take some seconds altogether."""
    return write_study(folder, sample='<sample method="random" runs="400"/>')


def _tuning(folder: Path) -> Path:
    """Write a study that tunes two gains, with runs that take some seconds altogether."""
    gains = (
        """<vary name="K_p" select="//gain[@name='K_p']/@value"><log_uniform from="0.1" to="1000"/></vary>"""
        """<vary name="k_d" select="//gain[@name='k_d']/@value"><uniform from="1" to="20"/></vary>"""
    )
    draws = 'training="1 to 3" held_out="11 to 18"'
    tune = f'<tune values="K_p k_d" evaluations="100" restarts="2" {draws} confidence="0.9">'
    return write_study(folder, gains + SEEDS, f'{tune}<cost of="last" per="10 mm"/></tune>')


def _inside(study: Path, there: Path) -> Path:
    """Let the scenario of a study have its law in an environment."""
    base = study.with_name("base.xml")
    base.write_text(base.read_text("utf-8").replace("<controller ", f'<controller environment="{there}" '), "utf-8")
    return study


def _result(path: Path) -> None:
    with h5py.File(path) as file:
        if file["pose"].shape[0] != file["time"].shape[0]:
            raise ValueError("pose and time have different lengths")
        file["pose"][:]


READERS: dict[str, Callable[[Path], object]] = {
    "runs/*/*.nc": _result,
    "runs/*/summary.json": lambda path: json.loads(path.read_text("utf-8")),
    "studies/*/*/summary.json": lambda path: json.loads(path.read_text("utf-8")),
    "all.xml": etree.parse,
    "built/*.fmu": lambda path: zipfile.ZipFile(path).testzip(),
    "runs/*/figure.png": lambda path: path.read_bytes().index(b"IEND"),
}


def _kill(pid: int, victim: int) -> Iterator[str]:
    """Kill a command, or a process that works for it."""
    with suppress(ProcessLookupError):
        os.kill(victim, signal.SIGKILL)
    while process_tree._state(victim) not in ("Z", ""):  # then its parent hears of it, here that of the cluster
        time.sleep(0.02)
    status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    if status not in STATUSES:
        yield f"it ends with status {status}"


def _stop(bench: Bench, pid: int, started: Sequence[int], rng: random.Random) -> Iterator[str]:
    """Stop a command as service managers and batch systems do: all its processes get the same signal at once."""
    log = bench.folder / "log"
    number, processes = rng.choice(SIGNALS), [pid, *started]
    said = log.stat().st_size
    rng.shuffle(processes)
    for process in processes:
        with suppress(ProcessLookupError):
            os.kill(process, number)
    give_up = time.monotonic() + LAST_MOMENT
    while process_tree._state(pid) != "Z" and time.monotonic() < give_up:
        time.sleep(0.02)
    if process_tree._state(pid) != "Z":
        yield f"after {signal.Signals(number).name} it goes on for {LAST_MOMENT:g} s"
        os.kill(pid, signal.SIGKILL)
    status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    with log.open("rb") as stream:
        stream.seek(said)
        told = stream.read().decode("utf-8", "replace")
    if status == -number and not told:  # it had only begun
        return
    if status not in STOPPED or "Traceback" in told:
        yield f"after {signal.Signals(number).name} it ends with status {status}, and says: {told[-1500:]}"


def kill(bench: Bench, kind: str, rng: random.Random, seconds: float, stop: bool) -> Iterator[str]:
    """Kill a command, or a process that works for it, or stop them all, at a random moment; return the findings."""
    if kind == "cluster":
        bench.start_cluster()
    pid, mark = bench.start(kind)
    time.sleep(rng.uniform(0.0, 1.1 * seconds))
    started = sorted({*living(mark), *process_tree._descendants(pid)} - {pid})  # what is forked shows no mark
    others = [*started, *(living(CLUSTER_MARK) if kind == "cluster" else [])]
    if stop:
        yield from _stop(bench, pid, started, rng)
    else:
        yield from _kill(pid, rng.choice(others) if others and rng.random() < 0.5 else pid)
    deadline = time.monotonic() + LAST_MOMENT
    while (left := living(mark, started)) and time.monotonic() < deadline:
        time.sleep(0.02)
    if left:
        yield f"the processes {left} are left"
        for process in left:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
    yield from bench.findings()


def living(mark: str, others: Sequence[int] = ()) -> list[int]:
    """Return the processes that have a mark in their environment as they were started, and others that live."""
    found = [process for process in others if process_tree._state(process) not in ("Z", "")]
    sought = f"{MARK}={mark}".encode()
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if sought in (process / "environ").read_bytes():
                found.append(int(process.name))
    return found


def whole(bench: Bench, kind: str) -> Iterator[str]:
    """Let a command run to its end; return the findings."""
    if kind == "cluster":
        bench.start_cluster()
    pid, _ = bench.start(kind)
    status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    if status != 0:
        yield f"the next command ends with status {status}: {(bench.folder / 'log').read_text('utf-8')[-1500:]}"
    yield from bench.findings()
    yield from (f"{path} is left" for path in bench.left())
    if kind in STUDIES and status == 0 and bench.outcome_differs(kind):
        yield "the files of the study differ from those of an uninterrupted one"
    if kind == "hosted":
        yield from (f"{name} has not passed" for name in HOSTED if not passed(bench.folder / "runs" / name))
    if kind in ("run", "figure"):
        yield from (f"{name} has not passed" for name in bench.names if not passed(bench.folder / "runs" / name))


def main() -> int:
    """Kill, and print every finding."""
    parser = argparse.ArgumentParser(prog="python -m tests.kills", description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="number of kills (1000)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the moments and of what is killed (1)")
    parser.add_argument("--stop", action="store_true", help="send SIGTERM, SIGINT or SIGHUP to all of them")
    parser.add_argument("--only", choices=KINDS, help="one command")
    options = parser.parse_args()
    rng, findings, done = random.Random(options.seed), 0, 0
    kinds = [options.only] if options.only else [kind for kind in KINDS if not (options.stop and kind in UNHEEDING)]
    with tempfile.TemporaryDirectory(prefix="kills-") as name:
        bench = Bench(Path(name))
        took: dict[str, float] = {}
        for kind in dict.fromkeys(kinds):
            with suppress(SystemExit):
                bench.call("study" if kind == "cluster" else kind)  # imports and compiles for all that are forked
            for number in SIGNALS:
                signal.signal(number, signal.SIG_DFL)
            bench.begin_anew(kind)
            begin = time.monotonic()
            findings += sum(1 for found in whole(bench, kind) if print(f"{kind}: {found}", flush=True) is None)
            took[kind] = time.monotonic() - begin
        while done < options.count:
            kind = rng.choice(kinds)
            if kind == "build" and rng.random() < 0.5:
                shutil.rmtree(bench.folder / "cache")
                (bench.folder / "cache").mkdir()
            bench.begin_anew(kind)
            for _ in range(min(KILLS, options.count - done)):
                done += 1
                for found in kill(bench, kind, rng, took[kind], options.stop):
                    findings += 1
                    print(f"kill {done} of {kind}: {found}", flush=True)
            for found in whole(bench, kind):
                findings += 1
                print(f"after kill {done} of {kind}: {found}", flush=True)
            if done % 20 < KILLS:
                print(f"{done} kills, {findings} findings", flush=True)
        bench.end_cluster()
        deadline = time.monotonic() + LAST_MOMENT  # what works for a killed worker notices that in a moment
        while (left := living(CLUSTER_MARK)) and time.monotonic() < deadline:
            time.sleep(0.02)
        if left:
            findings += 1
            print(f"the processes {left} of a cluster are left")
    print(f"{done} kills, {findings} findings")
    return min(findings, 1)


if __name__ == "__main__":
    sys.exit(main())
