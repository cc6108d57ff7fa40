"""``formation run``: run scenarios, print their summaries, and keep their results."""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from cosim.cli.checkpointing import Course
from cosim.cli.console import err, out, report, safe, table, taking_a_while, warn
from cosim.cli.earlier_results import RESULT, replaced, set_aside
from cosim.cli.ending import ended_by
from cosim.cli.fmi_rules import rules_kept
from cosim.cli.named_scenarios import read, take_name
from cosim.cli.summary import print_summary
from cosim.cli.watching import watched
from cosim.errors import InputError, OutputError, RunInterrupted, SimulationError
from cosim.master.foreign import for_whole_run
from cosim.master.interrupt import HeldSignals
from cosim.master.other_runs import run_other
from cosim.master.pacing import Pacer
from cosim.master.setup import set_up, size_of_result
from cosim.master.supervised import whole_run
from cosim.master.timing import timed
from cosim.report.page import PAGE, save_report
from cosim.results.figure_process import FigureProcess
from cosim.results.files import annotate, is_stream, save, writable_file, writable_folder, write
from cosim.results.junit import Outcome, junit_xml
from cosim.results.provenance import Provenance
from cosim.results.result import Result
from cosim.results.summary import Summary, summarise
from cosim.scenario.scenario import Scenario
from cosim.storage import Storage

if TYPE_CHECKING:
    from cosim.live.view import LiveView

EXPECTATION_FAILED = 1


def run(options: argparse.Namespace) -> int:
    """Run each scenario; return the most serious exit status of all."""
    if options.junit is not None:
        writable_file(options.junit, "--junit")
    outcomes: list[Outcome] = []
    try:
        with FigureProcess() as figures, watched(options) as live:
            return max(_run_scenarios(options, outcomes, figures, live), default=0)
    finally:
        if options.junit is not None:
            with HeldSignals():
                write(options.junit, junit_xml(outcomes))


def _run_scenarios(
    options: argparse.Namespace, outcomes: list[Outcome], figures: FigureProcess, live: LiveView | None
) -> Iterator[int]:
    """Run each scenario, keep its outcome, and yield its exit status."""
    names: dict[str, Path] = {}
    for path in options.scenarios:
        status = 0
        try:
            with ExitStack() as ending:  # the plants end last: everything is written and printed before
                status = _run_scenario(path, options, outcomes, names, figures, live, ending)
        except (Exception, SystemExit) as error:  # of an FMU at its end
            status = max(status, ended_by(error, path, several=len(options.scenarios) > 1)[1])
        yield status


def _run_scenario(
    path: Path,
    options: argparse.Namespace,
    outcomes: list[Outcome],
    names: dict[str, Path],
    figures: FigureProcess,
    live: LiveView | None,
    ending: ExitStack,
) -> int:
    started = time.perf_counter()
    outcome = Outcome(name=path.stem, path=path)
    try:
        scenario = read(path, options)
        outcome.name = scenario.name
        take_name(names, scenario, path)
        run_one(scenario, options, outcome, figures, live, ending, Course.of(options, scenario))
        return status_of_run(outcome)
    except (Exception, SystemExit) as error:  # whatever it is, the other scenarios are run
        outcome.error, status = ended_by(error, path, several=len(options.scenarios) > 1)
        return status
    except BaseException as error:
        outcome.error = error
        raise
    finally:
        outcome.seconds = time.perf_counter() - started
        outcomes.append(outcome)
        if options.junit is not None and not is_stream(options.junit):
            with suppress(OutputError), HeldSignals():  # the end of the command reports the error
                write(options.junit, junit_xml(outcomes))


def status_of_run(outcome: Outcome) -> int:
    """Return the exit status of a run that has ended as it should."""
    return 0 if outcome.summary is None or outcome.summary.passed or outcome.left else EXPECTATION_FAILED


def run_one(
    scenario: Scenario,
    options: argparse.Namespace,
    outcome: Outcome,
    figures: FigureProcess,
    live: LiveView | None,
    ending: ExitStack,
    course: Course,
) -> None:
    """Run a scenario, write and judge its result, and print its summary.

    Parameters
    ----------
    scenario, options
        The scenario, and the options of the command.
    outcome
        Gets the summary.
    figures, live
        Draw and show it.
    ending
        Receives the clean-up callbacks.
    course
        From where to where it goes.
    """
    out_folder, place = course.place.parent, course.place
    timing = {"imports": options.imports}
    failure: SimulationError | RunInterrupted | None = None
    pacer = _pacer(options.pace, scenario)
    if options.figure:
        figures.start()  # loads its libraries beside the run
    with timed(timing, "total"):
        resumed = course.checkpoint is not None
        kept = None if resumed else _set_aside(place, scenario)
        with (
            _told_if_refused(kept, out_folder),
            taking_a_while("building and loading plants, which is slow the first time"),
        ):
            storage = Storage(place)
            ending.callback(storage.release)
            scenario = for_whole_run(scenario)
            setup = set_up(scenario, ending, timing, storage=storage)
            for fmu in setup.fmus.values() if options.strict else ():
                rules_kept(fmu, strict=True)  # before any is started
            setup, start = course.begin(scenario, setup, ending)
            storage.reserve(size_of_result(scenario, setup.result_variables))
            gate = None if live is None else live.gate
            simulation = whole_run(scenario, setup, gate, start, course.checkpoints)
            ending.callback(simulation.close)
        if resumed:  # it can go on
            kept = _set_aside(place, scenario, checkpoints=False)
        if live is not None:
            live.show(simulation.records)
        with HeldSignals() as signals:
            # Absolute, as an FMU may change the working directory.
            folder = writable_folder(place, "--out").absolute()
            try:
                with _progress(scenario) as progress:
                    result = simulation.run_to_end(progress, pacer)
            except (SimulationError, RunInterrupted) as error:
                failure, result = error, error.recorded
            for part, seconds in simulation.timing.items():
                timing[part] = timing.get(part, 0.0) + seconds
            drawn = options.figure and result.sizes["time"] > 0
            storage.release()
            with timed(timing, "write"):
                _save(result, folder)
            if drawn:
                figures.draw(result, folder / "figure.png")
        if signals.received and not isinstance(failure, RunInterrupted):  # also while the result was being written
            if failure is not None:  # both: no further scenario is wanted
                report(failure)
            failure = RunInterrupted(min(simulation.time, scenario.horizon), result)
        console = out()
        # Judging may run other scenarios, to compare with: the result is safe by now.
        with timed(timing, "expectations"), taking_a_while("judging the expectations"):
            outcome.summary = summary = summarise(scenario, result, partial(run_other, simulation.setup))
        told = summary.provenance.failure
        outcome.left = str(told) if told is not None and told.left else ""
        if live is not None:
            live.finish(result, summary)
        write(folder / "summary.json", summary.to_json().encode())
        if summary.verdicts:
            annotate(folder / "result.nc", verdicts=summary.verdicts_as_json())
        if options.report and result.sizes["time"] > 0:
            with timed(timing, "page"):
                _write_page(result, summary, folder)
        print_summary(console, summary)
        if drawn:
            with timed(timing, "figure"):
                fault = figures.wait()
            if fault:  # everything else is saved already
                warn(f"the figure could not be drawn: {fault}")
    timing["total"] += options.imports

    if pacer is not None:
        console.print(str(pacer.report), soft_wrap=True)
    console.print(safe(f"results in {place}/"), soft_wrap=True)
    if kept is not None:
        console.print(safe(_where(kept, out_folder)), soft_wrap=True)
    if options.timing:
        _print_timing(console, timing, result.sizes["time"])
    course.tell(told, scenario)
    if failure is not None:
        if told is not None and not told.left:  # else it had reached its end already
            warn(
                f"the run ended early, at {told.time:.12g} s of {scenario.horizon:.12g} s; "
                "everything recorded up to then is saved"
            )
        raise failure


def _pacer(factor: float | None, scenario: Scenario) -> Pacer | None:
    if factor is None:
        return None
    try:
        return Pacer(scenario.step, factor)
    except ValueError as error:
        raise InputError(f"--pace {factor:g}: {error}") from None


# Files ------------------------------------------------------------------------------------------------------


def _set_aside(folder: Path, scenario: Scenario, checkpoints: bool = True) -> tuple[Path, Provenance] | None:
    """Take the results of the run before away; see `set_aside`."""
    try:
        return set_aside(folder, scenario.path, scenario.changes, checkpoints)
    except OSError as error:  # a run that can be computed is not refused for this
        warn(f"the results of the run before could not be kept and are overwritten: {error}")
        return None


@contextmanager
def _told_if_refused(kept: tuple[Path, Provenance] | None, out: Path) -> Iterator[None]:
    """Say where the results of the run before are, if this one is refused before it begins."""
    try:
        yield
    except Exception:
        if kept is not None:
            warn(_where(kept, out))
        raise


def _where(kept: tuple[Path, Provenance], out: Path) -> str:
    place, earlier = kept
    return f"results of the run before ({earlier.file}, {earlier.changed}) are kept in {out / place.name}/"


def _save(result: Result, folder: Path) -> None:
    """Write the result; if that fails, keep it in a temporary folder, which the error names."""
    try:
        save(result, folder / RESULT)
    except OutputError as error:
        kept = Path(tempfile.mkdtemp(prefix="formation-")) / RESULT
        save(result, kept)
        raise OutputError(f"{error}; it is kept in {kept}") from None
    replaced(folder)


def _write_page(result: Result, summary: Summary, folder: Path) -> None:
    try:
        save_report([result], folder / PAGE, [summary])
    except Exception as error:  # everything else is saved already
        warn(f"the page could not be written: {error if isinstance(error, OutputError) else repr(error)}")


# The terminal -----------------------------------------------------------------------------------------------


@contextmanager
def _progress(scenario: Scenario) -> Iterator[Callable[[int], None] | None]:
    """Show a progress bar on a terminal; elsewhere print a line if the run takes long."""
    if not err().is_terminal:
        with taking_a_while(f"running {scenario.name}"):
            yield None
        return
    every = max(1, scenario.ticks // 200)
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[time]:>8} s"),
        TimeRemainingColumn(),
        console=err(),
        transient=True,
    ) as progress:
        task = progress.add_task(scenario.name, total=scenario.ticks, time="0")

        def advance(tick: int) -> None:
            if tick % every == 0:
                progress.update(task, completed=tick, time=f"{tick * scenario.step:.1f}")

        yield advance


def _print_timing(console: Console, timing: dict[str, float], samples: int) -> None:
    parts = table(console, "Time")
    parts.add_column("part")
    parts.add_column("seconds", justify="right")
    for part, seconds in sorted(timing.items(), key=lambda item: item[0] == "total"):
        parts.add_row(part, f"{seconds:.3f}")
    if samples > 1:  # the first tick may compile the controller
        later = (timing["loop"] - timing["first tick"]) / (samples - 1)
        parts.add_row("loop, per later tick", f"{later * 1e6:.1f} us")
    console.print(parts)
