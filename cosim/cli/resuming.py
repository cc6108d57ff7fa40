"""``formation resume``: a run that was left goes on, or branches off from a moment."""

from __future__ import annotations

import argparse
import time
from contextlib import ExitStack
from pathlib import Path

from cosim.cli.checkpointing import Course, every_of, tick_of
from cosim.cli.console import err, say
from cosim.cli.earlier_results import CHECKPOINTS_BEFORE, RESULT, label, set_checkpoints_aside
from cosim.cli.ending import ended_by
from cosim.cli.run import run_one, status_of_run
from cosim.errors import InputError
from cosim.master.checkpoint import Checkpoint
from cosim.master.checkpoint_folder import FOLDER, HeldFolder, latest, name_of, readable, ticks_in
from cosim.master.foreign import for_whole_run
from cosim.master.setup import set_up
from cosim.master.supervised import whole_run
from cosim.results.figure_process import FigureProcess
from cosim.results.junit import Outcome
from cosim.results.netcdf import attributes_of
from cosim.results.provenance import Provenance
from cosim.scenario.edits import as_changes
from cosim.scenario.scenario import Scenario


def resume(options: argparse.Namespace) -> int:
    """Go on with a run; return the exit status of the whole."""
    outcome = Outcome(name=options.folder.name, path=options.folder)
    started = time.perf_counter()
    try:
        with ExitStack() as ending:
            course, scenario = _course(options, ending)
            with FigureProcess() as figures:
                run_one(scenario, options, outcome, figures, None, ending, course)
    except (Exception, SystemExit) as error:
        return ended_by(error, options.folder)[1]
    finally:
        outcome.seconds = time.perf_counter() - started
    return status_of_run(outcome)


def _course(options: argparse.Namespace, ending: ExitStack) -> tuple[Course, Scenario]:
    """Return the course that the run takes from now on, with its scenario."""
    folder: Path = options.folder
    checkpoints = (folder / FOLDER).absolute()
    found = latest(checkpoints) if options.at is None else readable(checkpoints)
    if found is None:
        raise InputError(_nothing(folder))
    found.origin.check_surroundings(found.path)
    changes = as_changes(options.set, options.horizon, options.expectations)
    if options.out is not None and not changes:
        raise InputError(
            f"--out {options.out}: a run without changes goes on in its own folder, {folder}; --set, --horizon or "
            "--no-expectations make another one"
        )
    at = None if options.at is None else tick_of("--at", options.at, found.scenario, least=0)
    if at is not None:
        _check_not_before_branch(at, found, folder)
    if at == 0 and not (checkpoints / name_of(0)).exists():
        raise InputError(
            f"--at {options.at}: there is no checkpoint of the start; formation run begins there, with --set"
        )
    if not changes and at is None:
        _check_not_complete(folder, found.scenario)
    held = None
    if not changes or (at is not None and not (checkpoints / name_of(at)).exists()):
        held = ending.enter_context(HeldFolder(checkpoints))
    if at is not None:
        found = _moved_to(at, found, held, folder)
    scenario = found.scenario.edited(changes)
    every = found.every if options.checkpoint is None else every_of(options.checkpoint, scenario)
    until = None if options.until is None else tick_of("--until", options.until, scenario)
    if until is not None and until <= found.state.tick:
        raise InputError(f"--until {options.until}: the run goes on from {found.time:.12g} s, so expected a later time")
    course = Course(folder, every, until, found, folder if changes else None, held=held)
    if changes:
        course.place, course.held = _place(options, found, scenario), None
    return course, scenario


def _moved_to(tick: int, found: Checkpoint, held: HeldFolder | None, folder: Path) -> Checkpoint:
    """Return the checkpoint at a tick; if there is none, the run goes on up to there from the last one before."""
    scenario = found.scenario
    before = latest(found.path.parent, tick)
    if before is not None and before.state.tick == tick:
        return before
    assert held is not None
    begin = 0.0 if before is None else before.time
    say(err(), f"running from {begin:.12g} s to {tick * scenario.step:.12g} s, where there is no checkpoint")
    course = Course(folder, found.every, tick, before, noted=False, held=held)
    scenario = for_whole_run(scenario)
    with ExitStack() as ending:
        setup, start = course.begin(scenario, set_up(scenario, ending, {}), ending)
        with whole_run(scenario, setup, None, start, course.checkpoints) as simulation:
            simulation.run_to_end()
    made = course.checkpoints
    if made is None or made.written != tick:
        raise InputError(f"there is no checkpoint at {tick * scenario.step:.12g} s: {made.fault if made else ''}")
    moved = latest(found.path.parent, tick)
    assert moved is not None
    return moved


def _place(options: argparse.Namespace, found: Checkpoint, scenario: Scenario) -> Path:
    """Return the folder of a run that goes on with changes, from which an earlier one is taken away."""
    folder: Path = options.folder
    more = scenario.changes[len(found.scenario.changes) :]
    about = Provenance(f"{folder.name}.xml", (f"--at {found.time:.12g}s", *more))
    place: Path = options.out or folder.with_name(f"{folder.name}+{label(about, folder.name)}")
    if place.absolute() == folder.absolute():
        raise InputError(f"--out {place} is the folder of the run that is to be kept: choose another one")
    set_checkpoints_aside(place)
    return place


def _check_not_before_branch(tick: int, found: Checkpoint, folder: Path) -> None:
    """Refuse a moment of a branch before its first checkpoint: up to there the run had another scenario."""
    branch = next((part for part in reversed(found.origin.parts) if part.scenario), None)
    if branch is None or any(own <= tick for own in ticks_in(found.path.parent)):
        return
    if tick < round(branch.until / found.scenario.step):
        whence = f" from {branch.run}" if branch.run else ""
        raise InputError(
            f"--at {tick * found.scenario.step:.12g}s: the run in {folder} branched off{whence} at "
            f"{branch.until:.12g} s; expected a moment from then on, or go on from {branch.run or 'the earlier run'}"
        )
    raise InputError(f"--at {tick * found.scenario.step:.12g}s: the branch in {folder} has no checkpoint up to then")


def _check_not_complete(folder: Path, scenario: Scenario) -> None:
    """Refuse to go on with a run that has reached its end."""
    try:
        attributes = attributes_of(folder / RESULT)
    except Exception:  # none, or none that is whole
        return
    if attributes.get("status") == "completed" and Provenance.of(attributes).changes == scenario.changes:
        raise InputError(
            f"the run in {folder} has reached its end at {scenario.horizon:.12g} s: --at TIME goes on from an earlier "
            "moment, with changes by --set"
        )


def _nothing(folder: Path) -> str:
    """Return why there is nothing to go on from."""
    if not folder.is_dir():
        return f"there is no folder {folder}; expected that of a run, such as runs/NAME"
    if (folder / CHECKPOINTS_BEFORE).is_dir():
        return (
            f"{folder} holds no checkpoint of its last run; those of the run before are in {CHECKPOINTS_BEFORE}: "
            f"rename this folder to {FOLDER} to go on from there"
        )
    return f"{folder} holds no checkpoint: formation run --checkpoint every=TIME writes some"
