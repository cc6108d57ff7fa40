"""``formation export``: a finished run as files of other tools, or a scenario as FMUs for other masters."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from cosim.cli.console import out, safe, taking_a_while, warn
from cosim.cli.named_scenarios import read
from cosim.cli.options import refuse
from cosim.errors import InputError
from cosim.export.formats import export_result, format_of
from cosim.quantity import quantity
from cosim.results.files import load_run, writable_file

_CHANGES = (
    "--set",
    "--seed",
    "--horizon",
    "--no-expectations",
    "--plant",
    "--binding",
    "--untrusted",
    "--controller",
    "--environment",
)
_DATED = ("--start-time",)
_FILM = ("--from", "--to", "--speed", "--fps", "--size")


def export(options: argparse.Namespace) -> int:
    """Write a result in each format that is asked for, or a scenario as a system of FMUs."""
    if options.ssp is not None or options.fmu is not None:
        return _export_scenario(options)
    refuse(options, _CHANGES, "changes a scenario, which --ssp or --fmu exports; a result stays as it is")
    refuse(options, ("--ssp-version",), "is about an SSP: add --ssp FILE.ssp, or leave it out")
    paths: list[Path] = options.out or [_usual_place(options.result)]
    formats = [format_of(path) for path in paths]
    if not any(one.moving for one in formats):
        refuse(options, _FILM, "is about moving pictures: add --out FILE.gif, .png or .mp4, or leave it out")
    if not any(one.dated for one in formats):
        refuse(options, _DATED, "is about .mcap: add --out FILE.mcap, or leave it out")
    for path in paths:
        writable_file(path, "--out")
    film: dict[str, Any] = {
        "begin": _seconds(options.begin, "--from"),
        "end": _seconds(options.end, "--to"),
        "speed": options.speed,
        "fps": options.fps,
        "size": _size(options.size),
    }
    result = load_run(options.result)
    for path in paths:
        export_result(result, path, options.start_time, **film)
        out().print(safe(f"{path}: {format_of(path).about}"), soft_wrap=True)
    return 0


def _export_scenario(options: argparse.Namespace) -> int:
    """Write a scenario as an SSP, as one FMU, or as both."""
    from cosim.ssp.exported import export_fmu, export_ssp

    refuse(options, ("--out", *_DATED, *_FILM), "is about a result, and --ssp and --fmu write a scenario")
    if options.ssp is None:
        refuse(options, ("--ssp-version",), "is about an SSP: add --ssp FILE.ssp, or leave it out")
    for path, option, ending in ((options.ssp, "--ssp", ".ssp"), (options.fmu, "--fmu", ".fmu")):
        if path is not None:
            if path.suffix != ending:
                raise InputError(f"{option} {path}: name a file that ends in {ending}")
            writable_file(path, option)
    scenario = read(options.result, options)
    notes: dict[str, None] = {}
    if options.ssp is not None:
        with taking_a_while(f"building the FMUs of {options.result}"):
            found = export_ssp(scenario, options.ssp, version=options.ssp_version)
        notes |= dict.fromkeys(found)
        out().print(safe(f"{options.ssp}: SSP {options.ssp_version}, {scenario.horizon:.12g} s"), soft_wrap=True)
        out().print(safe(_late(scenario.step)), soft_wrap=True)
    if options.fmu is not None:
        with taking_a_while(f"building the FMUs of {options.result}"):
            notes |= dict.fromkeys(export_fmu(scenario, options.fmu))
        out().print(safe(f"{options.fmu}: one FMU with the whole formation"), soft_wrap=True)
        if options.ssp is None:
            out().print(safe(_late(scenario.step)), soft_wrap=True)
    for note in notes:
        warn(note)
    return 0


def _late(step: float) -> str:
    return (
        f"the commands act one communication step late, under every master: compare with a run that has "
        f'<delay time="{step:.12g} s"/> in its <actuator>'
    )


def _usual_place(result: Path) -> Path:
    return (result if result.is_dir() else result.parent) / "result.mcap"


def _seconds(text: str | None, option: str) -> float | None:
    if text is None:
        return None
    try:
        return quantity(text, "s")
    except ValueError as error:
        raise InputError(f"{option}: {error}") from None


def _size(text: str) -> tuple[int, int]:
    width, cross, height = text.lower().partition("x")
    if not (cross and width.isascii() and width.isdigit() and height.isascii() and height.isdigit()):
        raise InputError(f'--size "{text}" is no size: expected width and height in pixels, such as 800x450')
    return int(width[:6]), int(height[:6])
