"""``formation compare-plants``: how far apart two plants are under the same commands."""

from __future__ import annotations

import argparse
import json
import math
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from rich.console import Console
from rich.table import Table

from cosim.cli.console import out, safe, table, warn
from cosim.cli.named_scenarios import pairs
from cosim.compare.comparison import PlantComparison, PlantFile, compare_plants
from cosim.compare.figure import save_comparison_figure
from cosim.errors import InputError, nearest
from cosim.quantity import quantity
from cosim.results.display_units import displayed
from cosim.results.files import writable_folder, write
from cosim.vehicle.kinds import kinds

BEYOND = 1


def compare(options: argparse.Namespace) -> int:
    """Drive two plants, print and draw how far apart they are; return 1 if they are not `within` a ``--within``."""
    a, b = (_plant(options, side) for side in "ab")
    folder = options.out or Path("runs") / f"{Path(a.fmu).stem}_and_{Path(b.fmu).stem}"
    duration, step = _quantity("--duration", options.duration, "s"), _quantity("--step", options.step, "s")
    pose = dict(_pose(options.pose))
    new = [place for place in (folder, *folder.parents) if not os.path.lexists(place)]
    try:
        writable_folder(folder, "--out")
        comparison = compare_plants(
            a,
            b,
            duration=duration,
            step=step,
            pose=pose,
            torque=options.torque,
            seed=options.seed,
            within=options.within,
        )
    except BaseException:
        for place in new:
            with suppress(OSError):
                place.rmdir()
        raise
    console = out()
    _print(console, comparison)
    write(folder / "compare.json", (json.dumps(comparison.to_dict(), indent=2) + "\n").encode())
    if options.figure:
        save_comparison_figure(comparison, folder / "compare.png")
    console.print(safe(f"results in {folder}/"), soft_wrap=True)
    for failure in comparison.failures:
        raise failure
    return BEYOND if options.within and not comparison.within else 0


def _plant(options: argparse.Namespace, side: str) -> PlantFile:
    both = dict(pairs("--parameter", options.parameter, "NAME=VALUE"))
    own = dict(pairs(f"--parameter-{side}", getattr(options, f"parameter_{side}"), "NAME=VALUE"))
    return PlantFile(
        fmu=getattr(options, side),
        binding=getattr(options, f"binding_{side}"),
        interface=getattr(options, f"interface_{side}"),
        solver=getattr(options, f"solver_{side}"),
        parameters=both | own,
        start=getattr(options, f"start_{side}"),
    )


def _pose(entries: list[str]) -> Iterator[tuple[str, float]]:
    known = {role.name: role.unit for kind in kinds() for role in kind.pose}
    for name, value in pairs("--pose", entries, "NAME=VALUE, such as 'psi=30 deg'"):
        if name not in known:
            raise InputError(f"--pose {name}={value}: there is no pose entry {name!r}: {nearest(name, list(known))}")
        yield name, _quantity(f"--pose {name}={value}", value, known[name])


def _quantity(option: str, text: str, unit: str) -> float:
    try:
        return quantity(text, unit)
    except ValueError as error:
        raise InputError(f"{option}: {error}") from None


# The terminal -----------------------------------------------------------------------------------------------


def _print(console: Console, comparison: PlantComparison) -> None:
    for name, about in zip("AB", comparison.plants, strict=True):
        said = (
            f"FMI {about['fmi_version']}, {about['interface']}, {about['generation_tool'] or 'made by an unknown tool'}"
        )
        shown = f"the built-in model {Path(about['file']).stem}" if about["built_in"] else about["file"]
        console.print(f"[bold]{name}[/]  {safe(shown)} ({safe(said)})", soft_wrap=True)
    pose = ", ".join(
        f"{role.name} = {_shown(float(comparison.states[0][0, i]), role.unit)}"
        for i, role in enumerate(comparison.kind.pose)
    )
    console.print(
        f"{comparison.time[-1]:.12g} s in steps of {comparison.step:.12g} s, from {pose} (as A shows it); "
        f"{comparison.kind.command_word}s: {safe(comparison.torque_from)}",
        soft_wrap=True,
    )
    for name, values in comparison.geometry.items():
        unit = comparison.kind.geometry[name].unit
        first, second = (f"{value:.6g} {unit}" if isinstance(value, float) else value for value in values)
        text = f"the {name.replace('_', ' ')} of A is {first}, of B {second}"
        if first != second:
            console.print(f"[yellow]they differ:[/] {safe(text)}", soft_wrap=True)
    if comparison.reached > 0:
        console.print(_differences(console, comparison))
    absent = comparison.not_offered
    if absent:
        console.print(f"not compared, because only one of the two offers it: {', '.join(absent)}", style="dim")
    if late := comparison.late:
        other = "BA"["AB".index(late)]
        console.print(
            f"[yellow]{late} is one step late:[/] its outputs are those of {other} one communication step before, "
            f"so a controller sees its motion {comparison.step:.12g} s later",
            soft_wrap=True,
        )
    for warning in comparison.warnings:
        console.print(f"[yellow]warning:[/] {safe(warning)}", soft_wrap=True)
    for message in comparison.messages:
        console.print(f"[yellow]note:[/] {safe(message)}", soft_wrap=True)
    if comparison.failures:
        reached = (
            f"compared up to {comparison.reached:.12g} s only" if comparison.reached > 0 else "nothing was compared"
        )
        warn(f"{reached}: a plant failed")


def _differences(console: Console, comparison: PlantComparison) -> Table:
    differences = table(console, "Difference of B from A")
    for heading in (
        "role",
        "unit",
        "largest",
        "at\n\\[s]",
        "RMS",
        "A's own\nrange",
        "tolerance",
        "beyond\nfrom \\[s]",
    ):
        left = heading in ("role", "unit")
        differences.add_column(heading, justify="left" if left else "right", no_wrap=True, overflow="fold")
    for found in comparison.roles:
        unit, factor = displayed(found.role.unit)
        figures = (found.largest, found.rms, found.span, found.tolerance)
        largest, rms, span, tolerance = (f"{figure * factor:.3g}" for figure in figures)
        beyond = "never" if found.first_beyond is None else f"{found.first_beyond:g}"
        if not math.isfinite(found.tolerance):
            tolerance, beyond = "any", ""
        differences.add_row(found.role.name, unit, largest, f"{found.at:g}", rms, span, tolerance, beyond)
    return differences


def _shown(value: float, unit: str) -> str:
    unit, factor = displayed(unit)
    return f"{value * factor:.6g} {unit}"
