"""``formation swap``: a scenario and a binding to start from, with another FMU as a plant."""

from __future__ import annotations

import argparse
import os
import shlex
from contextlib import ExitStack
from pathlib import Path

from cosim.cli.console import out, safe, table, warn
from cosim.cli.named_scenarios import pairs
from cosim.cli.overview import doubtful_plants
from cosim.errors import InputError
from cosim.fmu.capabilities import obstacle
from cosim.master.setup import set_up
from cosim.results.files import write
from cosim.scenario.reader import read_scenario
from cosim.swap.probe import DURATION, Probe
from cosim.swap.replacement import Replacement, Swap, swap


def swap_plants(options: argparse.Namespace) -> int:
    """Write a variant of a scenario and its bindings; print open questions, or check the variant if there are none."""
    fmus = {plant: Path(fmu) for plant, fmu in pairs("--plant", options.plant, "ID=FILE.fmu")}
    bindings = {plant: Path(file) for plant, file in pairs("--binding", options.binding, "ID=FILE.xml")}
    with ExitStack() as cleanup:
        swapped = swap(options.scenario, fmus, bindings, options.out, cleanup, drive=options.probe)
        if os.path.isdir(swapped.variant):
            raise InputError(
                f"--out {swapped.variant} is a folder: name the file of the variant, such as "
                f"{swapped.variant / 'swapped.xml'}"
            )
        if not options.force:
            _refuse_to_overwrite(swapped)
        for path, text in swapped.texts.items():
            write(path, text.encode())
            out().print(f"wrote {safe(str(path))}", soft_wrap=True)
        for note in swapped.notes:
            warn(note)
        opens = [_report(replacement) for replacement in swapped.replacements]
        for replacement in swapped.replacements if any(opens) else ():  # else the check reports it
            if sentence := obstacle(replacement.package):
                warn(sentence)
    variant = shlex.quote(str(swapped.variant))
    if any(opens):
        _next(f"formation check {variant}", "once the binding is complete")
        return 0
    with ExitStack() as cleanup:  # as formation check does; an error ends this command in the same way
        scenario = read_scenario(swapped.variant)
        for doubt in doubtful_plants(scenario, set_up(scenario, cleanup, {})):
            warn(doubt)
    _next(f"formation run {variant}", "to run it")
    return 0


def _refuse_to_overwrite(swapped: Swap) -> None:
    plants = {replacement.binding: replacement.plant for replacement in swapped.replacements}
    for path in swapped.texts:
        if os.path.exists(path):
            other = "--out names another file"
            if path in plants:
                other = f"--binding {plants[path]}={path} takes it unchanged"
            raise InputError(f"{path} exists: --force overwrites it, {other}")


def _report(replacement: Replacement) -> bool:
    """Print open questions and doubts of a binding; return whether a question is open."""
    proposal = replacement.proposal
    if proposal is None:
        return False
    fmu, console = replacement.package.path.name, out()
    if replacement.binding is None:
        console.print(f"{safe(fmu)} needs no binding: its variables have the names of the roles", soft_wrap=True)
        return False
    for what, suggestions, sentences in (
        ("to fill in", proposal.open, "open"),
        ("to look at", proposal.doubts, "doubts"),
    ):
        if suggestions:
            console.print(f"[bold]{what}[/], in {safe(str(replacement.binding))}:", soft_wrap=True)
            for suggestion in suggestions:
                for sentence in getattr(suggestion, sentences):
                    console.print(f"  {safe(suggestion.role.name)}: {safe(sentence)}", soft_wrap=True)
    if replacement.probe is not None:
        _show(replacement.probe)
    return bool(proposal.open)


def _show(probe: Probe) -> None:
    """Print the movements of the short drive."""
    if probe.problem:
        out().print(
            f"[bold]the short drive[/] to see which outputs move gave no answer: {safe(probe.problem)}", soft_wrap=True
        )
        return
    shown = table(out(), f"Movement in {DURATION:g} s, compared with no input")
    alone = [f"{name} = {probe.amplitude:g}" for name in probe.inputs]
    for heading in ("output", *alone, *(["all together"] if len(alone) > 1 else [])):
        shown.add_column(safe(heading), justify="left" if heading == "output" else "right", overflow="fold")
    moved = {name: changes for name, changes in probe.changes.items() if any(changes)}
    for name, changes in moved.items():
        shown.add_row(safe(name), *(f"{change:.3g}" for change in changes))
    if moved:
        out().print(shown)
    if still := [name for name in probe.changes if name not in moved]:
        out().print(f"outputs that do not move: {safe(', '.join(still))}", soft_wrap=True)


def _next(command: str, when: str) -> None:
    out().print(f"next, {when}: {safe(command)}", soft_wrap=True)
