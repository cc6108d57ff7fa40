"""``formation inspect --self-test``: an FMU's reference experiments, replayed and compared."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.table import Table

from cosim.cli.console import broken, out, safe, table, taking_a_while, warn
from cosim.cli.fmi_rules import rules_kept
from cosim.errors import InputError
from cosim.fmu.package import open_package
from cosim.fmu.reference_experiments import read_experiments
from cosim.fmu.self_test import Replay, replay


def self_test(fmu: Path, time_limit: float, *, strict: bool, every: bool) -> int:
    """Replay the reference experiments of an FMU, print how it agrees with them, and return the exit status.

    Parameters
    ----------
    fmu
        The FMU.
    time_limit
        Of an experiment [s].
    strict
        Whether a breach of a rule of FMI is refused, before the FMU is started.
    every
        Whether all warnings are printed, however many.

    Raises
    ------
    InputError
        The FMU cannot be opened, has no experiment or breaks a rule that `strict` refuses; or the limit is none.
    """
    if not time_limit > 0.0:
        raise InputError(f"--time-limit {time_limit:g}: expected a number of seconds greater than zero")
    package = open_package(fmu)
    try:
        rules_kept(package, strict, every=every)
        found = read_experiments(package)
        replays = []
        for number, experiment in enumerate(found.experiments, start=1):
            with taking_a_while(f"replaying experiment {number} of {len(found.experiments)}"):
                replays.append(replay(package, experiment, time_limit))
    finally:
        package.close()
    _print(out(), fmu, replays)
    for note in found.notes:
        warn(note)
    return 0 if all(done.holds for done in replays) else 1


def _print(console: Console, fmu: Path, replays: list[Replay]) -> None:
    for done in replays:
        title = safe(f"Self-test of {fmu.name}: {done.experiment.name}")
        if done.failure:
            console.print(f"{title} [red]failed:[/] {safe(done.failure)}", soft_wrap=True)
        elif not done.agreements:
            console.print(f"{title} ran, but it has no reference results to compare with", soft_wrap=True)
        else:
            console.print(_agreements(console, title, done))


def _agreements(console: Console, title: str, done: Replay) -> Table:
    shown = table(console, title)
    for heading in ("variable", "largest\ndifference", "allowed", "at", "verdict"):
        shown.add_column(heading, overflow="fold", justify="left" if heading in ("variable", "verdict") else "right")
    for agreement in done.agreements:
        largest = f"{agreement.largest:.2g}" if agreement.largest < float("inf") else "no number"
        shown.add_row(
            safe(broken(agreement.variable, console.width // 3)),
            largest,
            f"{agreement.allowed:.2g}",
            f"{agreement.time:g} s" if agreement.largest else "",
            "[green]agrees[/]" if agreement.holds else "[red]differs[/]",
        )
    return shown
