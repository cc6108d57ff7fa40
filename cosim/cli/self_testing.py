"""``formation inspect --self-test``: an FMU's reference experiments, replayed and compared."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from cosim.cli.console import out, safe, table, taking_a_while, warn
from cosim.errors import InputError
from cosim.fmu import open_package
from cosim.reference_experiments import read_experiments
from cosim.self_test import Replay, replay


def self_test(fmu: Path, time_limit: float) -> int:
    """Replay the reference experiments of an FMU, print how it agrees with them, and return the exit status."""
    if not time_limit > 0.0:
        raise InputError(f"--time-limit {time_limit:g}: expected is a number of seconds that is more than zero")
    package = open_package(fmu)
    try:
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
    shown = table(console, f"Self-test of {safe(fmu.name)}")
    for heading in ("experiment", "variable", "largest difference", "allowed", "at", "verdict"):
        shown.add_column(
            heading, overflow="fold", justify="right" if heading in ("largest difference", "allowed", "at") else "left"
        )
    for done in replays:
        name = safe(done.experiment.name)
        if done.failure:
            shown.add_row(name, "", "", "", "", f"[red]failed:[/] {safe(done.failure)}")
        elif not done.agreements:
            shown.add_row(name, "", "", "", "", "ran; there is nothing to compare with")
        for agreement in done.agreements:
            largest = f"{agreement.largest:.2g}" if agreement.largest < float("inf") else "no number"
            shown.add_row(
                name,
                safe(agreement.variable),
                largest,
                f"{agreement.allowed:.2g}",
                f"{agreement.time:g} s" if agreement.largest else "",
                "[green]agrees[/]" if agreement.holds else "[red]differs[/]",
            )
    console.print(shown)
