"""Formation's harness: scenarios in, co-simulated formations of robots out.

>>> import cosim
>>> result = cosim.run("scenarios/clmr_line.xml")            # an xarray.Dataset
>>> start = cosim.run("scenarios/clmr_line.xml", horizon=2.0, expectations=False)

or step by step:

>>> with cosim.Simulation(cosim.read_scenario("scenarios/clmr_line.xml")) as simulation:
...     while not simulation.finished:
...         simulation.step()

or many times with other values:

>>> with cosim.Prepared(cosim.read_scenario("scenarios/clmr_line.xml")) as prepared:
...     outcomes = [prepared.run([f"simulation/@seed={seed}"]) for seed in range(100)]

or as a study, which says in a file what varies and what must hold of all runs:

>>> table = cosim.study("studies/payload.xml")               # an xarray.Dataset over the runs

and later, from the files of ``formation run``:

>>> result = cosim.load_result("runs/clmr_line")
>>> summary = cosim.summary_of(result)                       # the table, notes and verdicts, as data
>>> cosim.save_figure(result, "figure.png")
>>> cosim.save_report([result], "report.html")               # several results: compared on one page
>>> cosim.export_result(result, "drive.mcap")                # or .csv, .mat

or, of a drive of real robots:

>>> result = cosim.judge_recording("drive.mcap", "scenarios/clmr_line.xml")
>>> cosim.summary_of(result).verdicts
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cosim import blas_room

if TYPE_CHECKING:
    from collections.abc import Iterable
    from concurrent.futures import Executor
    from pathlib import Path

    import xarray as xr

    from cosim.compare.comparison import PlantComparison, PlantFile, compare_plants
    from cosim.errors import FormationError, InputError, OutputError, RunInterrupted, SimulationError
    from cosim.export.formats import export_result
    from cosim.live.view import LiveView
    from cosim.master.pacing import Pacer
    from cosim.master.prepared import Prepared
    from cosim.master.simulation import Simulation
    from cosim.recordings.judge import judge_recording
    from cosim.report.page import save_report
    from cosim.results.figure import save_figure
    from cosim.results.files import load_result
    from cosim.results.outcome import RunOutcome
    from cosim.results.summary import Summary, summary_of
    from cosim.results.verdict import Verdict
    from cosim.scenario.edits import Change
    from cosim.scenario.reader import read_scenario
    from cosim.scenario.scenario import Scenario

__all__ = [
    "FormationError",
    "InputError",
    "LiveView",
    "OutputError",
    "Pacer",
    "PlantComparison",
    "PlantFile",
    "Prepared",
    "RunInterrupted",
    "RunOutcome",
    "Scenario",
    "Simulation",
    "SimulationError",
    "Summary",
    "Verdict",
    "compare_plants",
    "export_result",
    "judge_recording",
    "load_result",
    "read_scenario",
    "run",
    "save_figure",
    "save_report",
    "study",
    "summary_of",
]

blas_room.demand()


def run(
    scenario: str | Path | Scenario,
    changes: Iterable[str | Change] = (),
    *,
    horizon: float | str | None = None,
    expectations: bool = True,
) -> xr.Dataset:
    """Run a scenario to its horizon and return the result.

    Parameters
    ----------
    scenario
        A scenario, or the path of its file.
    changes, horizon, expectations
        Changes of it; see `Scenario.edited`.

    Raises
    ------
    InputError
        The scenario is wrong, or a package that it needs is not installed.
    SimulationError
        A plant or controller failed, or the motion diverged; its ``result`` holds everything up to then.
    RunInterrupted
        The user pressed Ctrl-C; its ``result`` holds everything up to then.
    """
    from cosim.master.supervised import whole_run
    from cosim.scenario.edits import as_changes
    from cosim.scenario.reader import read_scenario
    from cosim.scenario.scenario import Scenario

    made = as_changes(changes, horizon, expectations)
    read = scenario.edited(made) if isinstance(scenario, Scenario) else read_scenario(scenario, made)
    with whole_run(read) as whole:
        return whole.run_to_end().dataset


def study(
    path: str | Path,
    changes: Iterable[str | Change] = (),
    *,
    out: str | Path | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    scheduler: str | None = None,
    runs: int | None = None,
    keep: str = "",
) -> xr.Dataset:
    """Make the runs of a study and return its table, with the varied values as coordinates.

    Parameters
    ----------
    path
        The study's file.
    changes
        Changes of every scenario in it; see `Scenario.edited`.
    out
        A folder in which the runs are kept, in a folder of the study's name, so that the next call goes on there;
        None keeps nothing.
    workers
        How many runs are made at a time, each in a process of its own; None for one a processor, 0 for this process.
    executor
        An executor of `concurrent.futures`, in place of processes of this machine.
    scheduler
        The address of a scheduler of Dask, whose workers make the runs.
    runs
        Only the first ones.
    keep
        Runs whose full results are kept in `out`, besides those that the file keeps: ``all``, ``worst``, ``median`` or
        numbers such as ``3 5 to 9``. `load_result` reads one, ``load_result("OUT/NAME/kept/run_3")``.

    Raises
    ------
    InputError
        The study or a scenario of it is wrong.
    OutputError
        The rows cannot be written.
    KeyboardInterrupt
        The user pressed Ctrl-C; the runs so far are kept in `out`.
    """
    from pathlib import Path
    from tempfile import TemporaryDirectory

    from cosim.errors import InputError
    from cosim.results.files import writable_folder
    from cosim.studies.conduct import conduct
    from cosim.studies.kept_results import keep_results
    from cosim.studies.read_keep import keeping
    from cosim.studies.reader import read_study
    from cosim.studies.store import Store
    from cosim.studies.table import as_result

    if keep and out is None:
        raise InputError(f"keep={keep!r}: full results need a folder, out=...")
    read = keeping(read_study(path, changes), keep, "keep")
    with TemporaryDirectory(prefix="formation-study-") as nowhere:
        folder = writable_folder(Path(nowhere if out is None else out) / read.name, "out")
        with Store(folder, read.name) as store:
            outcome = conduct(
                read, folder, store=store, workers=workers, executor=executor, scheduler=scheduler, runs=runs
            )
            if out is not None:
                keep_results(outcome, folder, workers)
        return as_result(outcome).dataset


_HOMES = {
    "PlantComparison": "cosim.compare.comparison",
    "PlantFile": "cosim.compare.comparison",
    "compare_plants": "cosim.compare.comparison",
    "LiveView": "cosim.live.view",
    "Pacer": "cosim.master.pacing",
    "Prepared": "cosim.master.prepared",
    "RunOutcome": "cosim.results.outcome",
    "Scenario": "cosim.scenario.scenario",
    "Simulation": "cosim.master.simulation",
    "Summary": "cosim.results.summary",
    "Verdict": "cosim.results.verdict",
    "export_result": "cosim.export.formats",
    "judge_recording": "cosim.recordings.judge",
    "load_result": "cosim.results.files",
    "read_scenario": "cosim.scenario.reader",
    "save_figure": "cosim.results.figure",
    "save_report": "cosim.report.page",
    "summary_of": "cosim.results.summary",
}


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})


def __getattr__(name: str) -> object:  # the libraries of the master take a second to import
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_HOMES.get(name, "cosim.errors")), name)
