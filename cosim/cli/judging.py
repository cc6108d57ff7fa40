"""``formation judge``: a recorded drive under the expectations of a scenario."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from rich.console import Console

from cosim.cli.console import out, safe, say, table, taking_a_while
from cosim.cli.named_scenarios import read
from cosim.cli.summary import print_summary
from cosim.moments import SECOND
from cosim.recordings.drive import Drive
from cosim.recordings.judge import JudgedDrive, judge_drive
from cosim.report.page import PAGE, save_report
from cosim.results.files import save, writable_file, writable_folder, write
from cosim.results.junit import Outcome, junit_xml

EXPECTATION_FAILED = 1


def judge(options: argparse.Namespace) -> int:
    """Judge a recording, print and write what is asked for, and return the exit status."""
    if options.junit is not None:
        writable_file(options.junit, "--junit")
    began = time.perf_counter()
    outcome = Outcome(name=options.scenario.stem, path=options.scenario)
    try:
        scenario = read(options.scenario, options)
        outcome.name = scenario.name
        folder = None if options.out is None else writable_folder(options.out / scenario.name, "--out")
        with taking_a_while(f"reading {options.recording}"):
            judged = judge_drive(options.recording, scenario, options.map, start=options.start)
        outcome.summary = judged.summary
        console = out()
        _print_drive(console, judged.drive, options.recording)
        print_summary(console, judged.summary)
        if folder is not None:
            _write(judged, folder)
            console.print(safe(f"results in {folder}/"), soft_wrap=True)
        return 0 if judged.summary.passed else EXPECTATION_FAILED
    except BaseException as error:
        outcome.error = error
        raise
    finally:
        outcome.seconds = time.perf_counter() - began
        if options.junit is not None:
            write(options.junit, junit_xml([outcome]))


def _print_drive(console: Console, drive: Drive, path: Path) -> None:
    """Print what the recording has of each robot."""
    say(console, safe(f"recording {path}: the scenario begins at its {drive.start / SECOND:.12g} s"))
    shown = table(console, "")
    shown.add_column("robot", no_wrap=True)
    for heading in ("samples", "longest\ngap [s]", "ticks\nbridged", "ticks\nmissing"):
        shown.add_column(safe(heading), justify="right", no_wrap=True)
    for one in drive.tracked:
        missing = f"[yellow]{one.missing}[/]" if one.missing else "0"
        shown.add_row(safe(one.robot), str(one.samples), f"{one.longest_gap:.4g}", str(one.bridged), missing)
    console.print(shown)
    say(console, "bridged: interpolated across an interval that is longer than usual, or held at either end", "dim")


def _write(judged: JudgedDrive, folder: Path) -> None:
    save(judged.drive.result, folder / "result.nc")
    write(folder / "summary.json", judged.summary.to_json().encode())
    save_report([judged.drive.result], folder / PAGE, [judged.summary])
