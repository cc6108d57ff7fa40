"""The pytest plugin: each scenario file is a test, which passes when all its expectations hold.

pytest loads this module at every start, so it imports the harness only when a scenario runs.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from cosim.errors import FormationError, printable
from cosim.scenario.root_element import UNCLEAR, root_of

if TYPE_CHECKING:
    from _pytest._code.code import TerminalRepr, TracebackStyle

    from cosim.results.junit import Judged

MARKER = "study"


def pytest_configure(config: pytest.Config) -> None:
    """Make the marker of studies known."""
    config.addinivalue_line("markers", f'{MARKER}: a study, of many runs; -m "not {MARKER}" leaves them out')


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> ScenarioFile | None:
    """Collect a file if it is a scenario, a variant of one, or a study; no other XML file."""
    if file_path.suffix.lower() == ".xml" and root_of(file_path) in ("scenario", "variant", "study", UNCLEAR):
        file: ScenarioFile = ScenarioFile.from_parent(parent, path=file_path)
        name, shown = printable(file.name), printable(file.nodeid)
        if file.nodeid != shown:  # pytest breaks off where one is no text
            file = ScenarioFile.from_parent(parent, path=file_path, name=name, nodeid=shown)
        return file
    return None


class ScenarioFile(pytest.File):
    """A file of a scenario or a study."""

    def collect(self) -> Iterator[ScenarioItem]:
        """Return the one test that it is."""
        study = root_of(self.path) == "study"
        item = (StudyItem if study else ScenarioItem).from_parent(self, name=printable(self.path.stem))
        if study:
            item.add_marker(MARKER)
        yield item


class ScenarioItem(pytest.Item):
    """A scenario as a test: it runs, and its expectations hold or fail as they are marked."""

    def runtest(self) -> None:
        """Run the scenario and judge it; whatever nobody foresaw becomes an error with a sentence."""
        from cosim.unforeseen import foreseen

        try:
            self._run()
        except (_NotAsExpected, FormationError):
            raise
        except (Exception, SystemExit) as error:
            raise foreseen(error, str(self._shown_path())) from error

    def _run(self) -> None:
        from functools import partial

        from cosim.master.other_runs import run_other
        from cosim.master.supervised import whole_run
        from cosim.results.summary import summarise
        from cosim.scenario.reader import read_scenario

        scenario = read_scenario(self._shown_path())
        with whole_run(scenario) as simulation:
            run = partial(run_other, simulation.setup)
            self._judge(summarise(scenario, simulation.run_to_end(), run))  # before the plants end

    def _judge(self, summary: Judged) -> None:
        for verdict in summary.verdicts:
            name = " ".join(part for part in (verdict.expectation, verdict.robot) if part)
            self.user_properties.append((name, f"{verdict.outcome}: {verdict.finding}"))
        if not all(verdict.as_marked for verdict in summary.verdicts):
            raise _NotAsExpected(summary)
        known = dict.fromkeys(verdict.known_failure for verdict in summary.verdicts if not verdict.passed)
        if known:
            pytest.xfail(printable("; ".join(known)))
        if not summary.passed:  # the option --runxfail: pytest treats a marked failure like any other
            raise _NotAsExpected(summary)

    def repr_failure(
        self, excinfo: pytest.ExceptionInfo[BaseException], style: TracebackStyle | None = None
    ) -> str | TerminalRepr:
        """Return the report: verdicts, or one sentence on the fault."""
        if isinstance(excinfo.value, _NotAsExpected):
            return printable("\n".join(_report(excinfo.value.summary)))
        if isinstance(excinfo.value, FormationError):
            return printable(str(excinfo.value))
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int, str]:
        """Return the place and the name of the test."""
        return Path(printable(str(self.path))), 0, f"scenario: {self.name}"

    def _shown_path(self) -> Path:
        """Return the file as it is named from where pytest was started."""
        start = self.config.invocation_params.dir
        return self.path.relative_to(start) if self.path.is_relative_to(start) and Path.cwd() == start else self.path


class StudyItem(ScenarioItem):
    """A study as a test: its runs are made, and what must hold of them holds or fails as it is marked."""

    def _run(self) -> None:
        from tempfile import TemporaryDirectory

        from cosim.studies.conduct import conduct
        from cosim.studies.reader import read_study

        study = read_study(self._shown_path())
        with TemporaryDirectory(prefix="formation-study-") as folder:
            self._judge(conduct(study, Path(folder)))

    def reportinfo(self) -> tuple[Path, int, str]:
        """Return the place and the name of the test."""
        return Path(printable(str(self.path))), 0, f"study: {self.name}"


class _NotAsExpected(Exception):
    def __init__(self, summary: Judged) -> None:
        self.summary = summary
        super().__init__("not as expected")


def _report(summary: Judged) -> Iterable[str]:
    """Return a line for each verdict, unexpected ones first, and the notes."""
    for verdict in sorted(summary.verdicts, key=lambda verdict: verdict.as_marked):
        yield f"{verdict.where}: {verdict.outcome}: {verdict}"
    for note in getattr(summary, "notes", ()):
        yield f"note: {note}"
