"""One run of a study with its full results, made as ``formation run`` makes it, in a folder of its own."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from cosim.errors import FormationError, OutputError, SimulationError
from cosim.master.code import check_code, code_of
from cosim.master.foreign import for_whole_run
from cosim.master.other_runs import run_other
from cosim.master.setup import Setup, set_up, size_of_result
from cosim.master.supervised import whole_run
from cosim.results.files import save, write
from cosim.results.netcdf import attributes_of
from cosim.results.summary import summarise
from cosim.scenario.reader import read_scenario
from cosim.scenario.scenario import Scenario
from cosim.storage import Storage
from cosim.unforeseen import lack_of

SCENARIO, SUMMARY, RESULT = "scenario.xml", "summary.json", "result.nc"
_KEY = "study_run"
"""The attribute of a result that has the key of its run."""


@dataclass(frozen=True)
class KeptRun:
    """A task for another process: one run, whose full results are kept.

    Attributes
    ----------
    folder : Path
        Where its scenario is, and its results will be.
    key : str
        What determines the run; see `cosim.studies.keys`.
    runs : int
        How many results of its size shall find room.
    usual : float
        The time [s] that it takes, about.
    code : dict
        The code that made its row; see `cosim.master.code`.
    """

    folder: Path
    key: str
    runs: int
    usual: float
    code: Mapping[str, str]

    def make(self) -> None:
        """Make the run and write its summary, and its result, which is last; see `keep_results`.

        Raises
        ------
        FormationError
            It cannot begin, or its results cannot be written.
        """
        scenario = for_whole_run(read_scenario(self.folder / SCENARIO))
        with ExitStack() as cleanup:
            setup = set_up(scenario, cleanup, {}, storage=Storage(self.folder))
            check_code(self.code, code_of(setup))
            self._check_room(scenario, setup)
            simulation = whole_run(scenario, setup)
            cleanup.callback(simulation.close)
            try:
                result = simulation.run_to_end()
            except SimulationError as error:
                if error.recorded is None:
                    raise
                result = error.recorded
            summary = summarise(scenario, result, partial(run_other, simulation.setup))
            told = {"verdicts": summary.verdicts_as_json()} if summary.verdicts else {}
            write(self.folder / SUMMARY, summary.to_json().encode())
            save(replace(result, attrs={**result.attrs, **told, _KEY: self.key}), self.folder / RESULT)

    def answers(self) -> Iterator[str]:
        """Make the run, and return why its results cannot be written; empty if they are, or if it cannot begin.

        Raises
        ------
        FormationError
            The machine lacks what it needs.
        """
        try:
            self.make()
        except FormationError as error:
            if lack_of(error):
                raise
            yield str(error) if isinstance(error, OutputError) else ""  # its row says why it cannot begin
        else:
            yield ""

    def _check_room(self, scenario: Scenario, setup: Setup) -> None:
        needed = self.runs * size_of_result(scenario, setup.result_variables)
        if needed > (free := shutil.disk_usage(self.folder).free):
            raise OutputError(
                f"the full results of {self.runs} runs need {needed / 1e9:.3g} GB, and {self.folder.parent} has room "
                f"for {free / 1e9:.3g} GB: ask for fewer runs, or give another folder"
            )


def key_in(folder: Path) -> str:
    """Return the key of the run whose result a folder has; empty if there is none that is whole."""
    try:
        return str(attributes_of(folder / RESULT).get(_KEY, ""))
    except OSError:
        return ""
