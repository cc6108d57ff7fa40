"""``formation run``: run scenarios, say how they went, and keep what they gave."""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from itertools import groupby
from pathlib import Path

import xarray as xr
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from cosim.cli.console import err, out, report, table, warn
from cosim.errors import FormationError, InputError, OutputError, RunInterrupted, SimulationError
from cosim.result import save, write
from cosim.scenario import Scenario, read_scenario, with_controller, with_fmu, with_seed
from cosim.simulation import Simulation
from cosim.summary import Summary, summarise

EXPECTATION_FAILED = 1


def run(options: argparse.Namespace) -> int:
    """Run each scenario; return the most serious exit status of all."""
    status = 0
    names: dict[str, Path] = {}
    for path in options.scenarios:
        try:
            scenario = _read(path, options)
            if scenario.name in names:
                raise InputError(f"{path} has the same name {scenario.name!r} as {names[scenario.name]}")
            names[scenario.name] = path
            status = max(status, _run_one(scenario, options))
        except FormationError as error:
            report(error)
            status = max(status, error.exit_status)
    return status


def _read(path: Path, options: argparse.Namespace) -> Scenario:
    scenario = read_scenario(path, options.set)
    if options.seed is not None:
        scenario = with_seed(scenario, options.seed)
    for plant, fmu in _pairs("--plant", options.plant, "ID=FMU"):
        scenario = with_fmu(scenario, plant, Path(fmu))
    for controller, name in _pairs("--controller", options.controller, "ID=NAME"):
        scenario = with_controller(scenario, controller, name)
    return scenario


def _pairs(option: str, values: list[str], form: str) -> Iterator[tuple[str, str]]:
    for value in values:
        left, equals, right = value.partition("=")
        if not (left and equals and right):
            raise InputError(f"{option} {value}: expected {form}")
        yield left, right


def _run_one(scenario: Scenario, options: argparse.Namespace) -> int:
    started = time.perf_counter()
    failure: SimulationError | RunInterrupted | None = None
    with _status("building and loading plants"):
        ready = Simulation(scenario)
    with ready as simulation:
        folder = _writable_folder(options.out / scenario.name)
        try:
            with _progress(scenario) as progress:
                result = simulation.run(progress)
        except (SimulationError, RunInterrupted) as error:
            failure, result = error, error.result
    timing = {"imports": options.imports, **simulation.timing}

    console = out()
    summary = summarise(scenario, result)
    _print_summary(console, scenario, summary)
    with _timed(timing, "write"):
        _write(result, summary, folder)
    figure = folder / "figure.png"
    figure.unlink(missing_ok=True)
    if options.figure and result.sizes["time"] > 1:
        with _timed(timing, "figure"):
            from cosim.figure import save_figure

            save_figure(result, figure)
    timing["total"] = time.perf_counter() - started + options.imports

    console.print(f"results in {folder}/", markup=False, soft_wrap=True)
    if options.timing:
        _print_timing(console, timing, scenario)
    if failure is not None:
        warn(f"the run ended early, at {failure.time:.6g} s of {scenario.horizon:g} s; what was recorded is saved")
        raise failure
    return 0 if summary.passed else EXPECTATION_FAILED


# Files ------------------------------------------------------------------------------------------------------


def _writable_folder(folder: Path) -> Path:
    """Make the folder of the results and try it, before anything is computed."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise OutputError(f"results cannot be written to {folder}: {error.strerror}; choose another --out") from None
    return folder


def _write(result: xr.Dataset, summary: Summary, folder: Path) -> None:
    """Write result and summary; where that fails after all, keep the result in a temporary folder and say so."""
    try:
        save(result, folder / "result.nc")
        write(folder / "summary.json", summary.to_json().encode())
    except OutputError as error:
        kept = Path(tempfile.mkdtemp(prefix="formation-")) / "result.nc"
        save(result, kept)
        raise OutputError(f"{error}; it is kept in {kept}") from None


# The terminal -----------------------------------------------------------------------------------------------


def _status(message: str) -> AbstractContextManager[object]:
    """Say on a terminal what takes a while."""
    return err().status(message) if sys.stderr.isatty() else nullcontext()


@contextmanager
def _progress(scenario: Scenario) -> Iterator[Callable[[int], None] | None]:
    """Show a progress bar on a terminal, nothing elsewhere."""
    if not sys.stderr.isatty():
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


def _print_summary(console: Console, scenario: Scenario, summary: Summary) -> None:
    figures = table(escape(f"{scenario.name}: {scenario.title}"))
    for heading in (
        "follower",
        "settled after [s]",
        "range RMS [m]",
        "bearing RMS [deg]",
        "peak torque [N.m]",
    ):
        figures.add_column(escape(heading), justify="left" if heading == "follower" else "right", no_wrap=True)
    for follower in summary.followers:
        settled = follower.settling_time
        figures.add_row(
            follower.robot,
            "[yellow]not settled[/]" if settled is None else f"{settled:.2f}",
            _shown(follower.range_rms, 4),
            _shown(math.degrees(follower.bearing_rms), 3),
            _shown(follower.peak_torque, 1),
        )
    console.print(figures)
    console.print("RMS over the last fifth of the run; settled: within 0.1 m and 2 deg from then on.", style="dim")
    if summary.smallest_distance is not None and summary.smallest_distance_between:
        a, b = summary.smallest_distance_between
        console.print(
            f"smallest distance between followers: {summary.smallest_distance:.3f} m ({a}, {b})", markup=False
        )
    for note in summary.notes:
        console.print(f"[yellow]note:[/] {escape(note)}", soft_wrap=True)
    for expectation, verdicts in groupby(summary.verdicts, key=lambda verdict: verdict.expectation):
        worst = max(verdicts, key=lambda verdict: verdict.figure)
        word = "[green]holds[/]" if worst.passed else "[bold red]FAILS[/]"
        console.print(
            f"{word}  {escape(expectation)} below {worst.bound:g} {worst.unit}: "
            f"at most {worst.figure:.4g} {worst.unit} ({escape(worst.robot)})",
            soft_wrap=True,
        )


def _shown(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"  # a run cut short has no last fifth


def _print_timing(console: Console, timing: dict[str, float], scenario: Scenario) -> None:
    parts = table("Time")
    parts.add_column("part")
    parts.add_column("seconds", justify="right")
    for part, seconds in timing.items():
        parts.add_row(part, f"{seconds:.3f}")
    parts.add_row("loop, per tick", f"{timing['loop'] / (scenario.ticks + 1) * 1e6:.1f} us")
    console.print(parts)


@contextmanager
def _timed(timing: dict[str, float], part: str) -> Iterator[None]:
    started = time.perf_counter()
    yield
    timing[part] = time.perf_counter() - started
