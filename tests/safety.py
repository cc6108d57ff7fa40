"""The table of what misbehaving FMUs do to a run: ``python -m tests.safety`` writes it into ``docs/trust.md``.

One command runs a scenario with each of them, one after the other, and a scenario with a good FMU at the end; once in
the supervised process and once with a process for each robot.
"""

from __future__ import annotations

import json
import os
import re
import secrets
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree
from numpy.typing import NDArray

import cosim.errors
from cosim.tests.driving import scenario
from tests.saved import saved
from tests.stub.broken import EVIL, make_broken
from tests.stub.stub import make_fmu

PAGE = Path(__file__).parents[1] / "docs" / "trust.md"
MODES = {"supervised": "", "isolated": 'isolate="process"'}
STEP = 0.02
WHEN = 0.5
"""When an FMU goes wrong in a step [s]."""
BEFORE = 26
"""Samples up to then."""
ALL = 31
LIMIT = 0.5
"""Time limit of those that hang [s]."""

ENDS = {
    "segfault": "writes to an address that is not its own",
    "abort": "calls `abort()`",
    "overflow": "lets its stack overflow",
    "exit_0": "calls `exit(0)`",
    "exit": "calls `exit(7)`",
    "hang": "sleeps for ever",
    "hang_stubborn": "sleeps for ever and ignores signals",
}
"""What ends or hangs the process of an FMU, wherever it happens."""
PLACES = {
    "step": f"in a step at {WHEN:g} s",
    "instantiate": "as it starts",
    "load": "as it is loaded",
    "free": "as it ends",
}
LINES = 1_000_000


@dataclass(frozen=True)
class Row:
    """A misbehaving FMU, and what the page calls it; `options` are those of `make_fmu`, or the kind is broken."""

    name: str
    what: str = ""
    broken: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def hangs(self) -> bool:
        return self.options["behaviour"] in ("hang", "hang_stubborn", "daemon_hang") if self.options else False

    def write(self, folder: Path) -> Path:
        """Write the FMU."""
        if self.broken:
            return make_broken(folder / self.name, self.broken)
        return make_fmu(folder, name=self.name, when=WHEN, **self.options)


def _bad(behaviour: str, place: str = "step", what: str = "", **more: Any) -> Row:
    return Row(f"{behaviour}_{place}", what, options={"behaviour": behaviour, "place": place, **more})


MATRIX = [_bad(behaviour, place) for behaviour in ENDS for place in PLACES]
LIST = [
    _bad("thread_crash", what="has a thread that crashes later"),
    _bad("daemon", what="forks a process that calls `setsid()` and sleeps for ever"),
    _bad("daemon_hang", what="likewise, and then sleeps for ever itself"),
    _bad("discard", what="returns Discard from a step"),
    _bad("error", what="returns Error from a step"),
    _bad("fatal_strict", what="returns Fatal from a step, and aborts when it is called once more"),
    _bad("error", "instantiate", "returns no instance"),
    _bad("nan", what="has a NaN among its outputs"),
    _bad("infinity", what="has an infinite output"),
    _bad("log_million", what="logs a million lines in a step", lines=LINES),
    _bad("garbage", what="writes garbage into the pipe to the harness"),
    _bad("garbage_endless", what="writes garbage into the pipe without end"),
    _bad("close_pipes", what="closes its pipe, and sleeps for ever"),
    Row("parent_entry", "has an entry `../...` in its archive", "parent_entry"),
    Row("absolute_entry", "has an entry `/tmp/...`", "absolute_entry"),
    Row("link_entry", "has a symbolic link that leads out of it", "link_entry"),
    Row("truncated", "is truncated", "truncated"),
    Row("crc", "has an entry with a wrong checksum", "crc"),
    Row("entity_bomb", "has entities in its description that grow to gigabytes", "entity_bomb"),
]
ROWS = [*MATRIX, *LIST]
SOME = (
    "segfault_step",
    "exit_0_instantiate",
    "exit_load",
    "hang_stubborn_step",
    "abort_free",
    "thread_crash_step",
    "daemon_hang_step",
    "error_step",
    "nan_step",
    "garbage_step",
    "crc",
)
"""Rows of which one that is like them is enough where each costs a second."""
GOOD = Row("good", "behaves", options={"behaviour": "good"})


@dataclass(frozen=True)
class Outcome:
    """The outcome of a run: exit status, samples and poses that were kept, and the message, if any."""

    status: int
    samples: int
    told: str
    poses: NDArray[np.float64]


@dataclass(frozen=True)
class Command:
    """A command with a scenario for each row and a good one: exit status, outcomes, standard error, and leftovers."""

    status: int
    outcomes: Mapping[str, Outcome]
    printed: str
    left: Sequence[str]
    folder: Path


def run(folder: Path, mode: str, rows: Sequence[Row] = ROWS) -> Command:
    """Run rows in a mode, after runs of the same scenarios that had passed."""
    good = GOOD.write(folder)
    here = 'isolate="no"' if mode == "isolated" else ""  # another foreign FMU would take the run to that process
    paths = []
    for row in [*rows, GOOD]:
        limit = f'time_limit="{LIMIT if row.hangs else 600} s"'
        plants = f'<plant id="good" fmu="{good}" {here}/>'
        plants += f'<plant id="bad" fmu="{row.write(folder / "fmus")}" {MODES[mode]} {limit}/>'
        path = folder / f"{row.name}.xml"
        paths.append(scenario(path, plants, leader="good", followers=["bad"], horizon="0.6 s", step=f"{STEP} s"))
        (folder / row.name).mkdir()
        (folder / row.name / "summary.json").write_text('{"passed": true}')  # of an earlier run
    (folder / "tmp").mkdir()
    mark = secrets.token_hex(8)
    program = "import sys; from cosim.cli import entry; entry()"
    arguments = ["run", *map(str, paths), "--out", str(folder), "--no-figure", "--junit", str(folder / "all.xml")]
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        env={**os.environ, "TMPDIR": str(folder / "tmp"), "FORMATION_SAFETY": mark},
        capture_output=True, text=True, errors="replace", check=False, timeout=600,
    )  # fmt: skip
    left = [str(path) for path in (folder / "tmp").iterdir()] + list(_processes(mark))
    left += [str(path) for path in [*folder.rglob(EVIL), Path("/tmp") / EVIL] if path.exists()]
    outcomes = {path.stem: _outcome(folder / "all.xml", path) for path in paths}
    return Command(done.returncode, outcomes, done.stderr, left, folder)


def _outcome(junit: Path, path: Path) -> Outcome:
    """Return the outcome of a scenario."""
    [case] = (case for case in etree.parse(junit).iter("testcase") if case.get("file") == str(path))
    error = case.find("error")
    status = 0 if error is None else getattr(cosim.errors, str(error.get("type"))).exit_status
    told = "" if error is None else str(error.get("message"))
    result = path.parent / path.stem / "result.nc"
    poses = saved(result).pose if result.exists() else np.zeros((0, 1, 4))
    return Outcome(status, len(poses), told, poses)


def _processes(mark: str) -> Iterator[str]:
    """Return the processes that live and have a mark in their environment."""
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if mark.encode() in (process / "environ").read_bytes():
                yield f"{process.name} {(process / 'cmdline').read_bytes()!r}"
        except OSError:
            continue


def passed(folder: Path) -> bool:
    """Return whether a summary says that a run has passed."""
    path = folder / "summary.json"
    return path.exists() and json.loads(path.read_text("utf-8"))["passed"] is not False


# The page ---------------------------------------------------------------------------------------------------


def tables(found: Mapping[str, Mapping[str, Outcome]]) -> str:
    """Return the tables of the page, in Markdown."""
    lines = [f"| an FMU that ... | {' | '.join(PLACES.values())} | what is told |", "|---" * (len(PLACES) + 2) + "|"]
    for behaviour, what in ENDS.items():
        names = [f"{behaviour}_{place}" for place in PLACES]
        cells = [_either(found, name, _cell) for name in names]
        told = dict.fromkeys(filter(None, (_either(found, name, _told) for name in names)))
        lines.append(f"| {what} | {' | '.join(cells)} | {'; '.join(told)} |")
    lines += ["", "| an FMU that ... | outcome | what is told |", "|---" * 3 + "|"]
    for row in LIST:
        lines.append(f"| {row.what} | {_either(found, row.name, _cell)} | {_either(found, row.name, _told)} |")
    return "\n".join(lines) + "\n"


def _either(found: Mapping[str, Mapping[str, Outcome]], name: str, say: Any) -> str:
    """Return what is said of a row, of each mode if they differ."""
    said = {mode: say(outcomes[name]) for mode, outcomes in found.items()}
    if len(set(said.values())) == 1:
        return str(said[next(iter(said))])
    return "; ".join(f"{mode}: {text}" for mode, text in said.items())


def _cell(outcome: Outcome) -> str:
    if outcome.samples == ALL:
        return f"{outcome.status}, whole"
    return f"{outcome.status}, kept to {(outcome.samples - 1) * STEP:.3g} s" if outcome.samples else f"{outcome.status}"


_LEFT_OUT = (
    r"^\S+\.xml:\d+:\d+: ",
    r"^follower_1 at t = [\d.]+ s: ",
    r"^(the (FMU|plant) )?\S+\.fmu ",
    r"^cannot be started as follower_1: ",
    r"^(it )?did not (start|complete the step):? ?",
    r"; it had logged: .*",
    r": step returns .*",
    "formation-stub-",
    "in its modelDescription.xml",
)
"""What is left out of a message on the page: above all place, robot, time and FMU, which all of them have."""


def _told(outcome: Outcome) -> str:
    text = outcome.told
    for pattern in _LEFT_OUT:
        text = re.sub(pattern, "", text)
    return text.strip().replace("|", "\\|")


def with_tables(page: str, text: str) -> str:
    """Return a page with other tables between its two marks."""
    begin, end = "<!-- tables: python -m tests.safety -->\n", "<!-- end of the tables -->"
    head, _, rest = page.partition(begin)
    return f"{head}{begin}{text}{end}{rest.partition(end)[2]}"


def main() -> None:
    """Run everything and write the page."""
    with tempfile.TemporaryDirectory(prefix="safety-") as name:
        found = {mode: run(Path(name) / mode, mode).outcomes for mode in MODES}
    PAGE.write_text(with_tables(PAGE.read_text("utf-8"), tables(found)), encoding="utf-8")


if __name__ == "__main__":
    main()
