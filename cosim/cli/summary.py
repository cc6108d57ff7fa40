"""The summary of a run as the terminal shows it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import groupby

from rich.console import Console

from cosim.cli.console import safe, say, table
from cosim.results.follower_figures import FollowerFigures
from cosim.results.summary import Summary
from cosim.results.verdict import Verdict

NARROW = 72
"""Columns of a terminal below which headings have a word a line."""

_OVERLAP = (
    "bodies overlap: robots that touch do not collide here, and only their control law can keep them apart; "
    '<distance of="bodies" above="0 m"/> expects that it does'
)


def print_summary(console: Console, summary: Summary) -> None:
    """Print the table of the followers, the changes, the notes and the verdicts."""
    figures = table(console, safe(f"{summary.scenario}: {summary.title}"))
    figures.add_column("follower", no_wrap=True)
    with_torques = any(math.isfinite(follower.peak_torque) for follower in summary.followers)
    headings = ("settled\nafter [s]", "range\nRMS [m]", "bearing\nRMS [deg]", *["peak torque\n[N.m]"] * with_torques)
    for heading in headings:
        lines = heading if console.width >= NARROW else heading.replace(" ", "\n")
        figures.add_column(safe(lines), justify="right", no_wrap=True)
    for follower in summary.followers:
        figures.add_row(
            safe(follower.robot),
            _settled(follower),
            _shown(follower.range_rms, 4),
            _shown(math.degrees(follower.bearing_rms), 3),
            *[_shown(follower.peak_torque, 1)] * with_torques,
        )
    console.print(figures)
    say(console, "RMS over the last fifth of the run; settled: within 0.1 m and 2 deg from then on", "dim")
    late = [follower.within_from is not None for follower in summary.followers if follower.settling_time is None]
    if not all(late):
        say(console, "outside: not within 0.1 m and 2 deg at the end", "dim")
    if any(late):
        say(console, "since: within 0.1 m and 2 deg, but for less than a twentieth of the run", "dim")
    say(console, safe(summary.provenance.basis), "dim")
    for told in (summary.provenance.changed if summary.provenance.changes else "", summary.provenance.resumed):
        if told:
            say(console, f"[yellow]{safe(told)}[/]")
    distances = [
        f"{what} {distance:.3f} m ({', '.join(between)})"
        for what, distance, between in (
            ("reference points", summary.smallest_distance, summary.smallest_distance_between),
            ("bodies", summary.smallest_distance_of_bodies, summary.smallest_distance_of_bodies_between),
        )
        if distance is not None and between and not math.isnan(distance)
    ]
    if distances:
        say(console, safe(f"smallest distance between followers: {', '.join(distances)}"))
    if summary.smallest_distance_of_bodies == 0.0:
        say(console, f"[yellow]note:[/] {_OVERLAP}")
    for note in summary.notes:
        say(console, f"[yellow]note:[/] {safe(note)}")
    for verdict in _worst(summary.verdicts):
        print_verdict(console, verdict)


def print_verdict(console: Console, verdict: Verdict) -> None:
    """Print a verdict."""
    colour = ("green" if verdict.passed else "yellow") if verdict.as_marked else "bold red"
    say(console, f"[{colour}]{safe(verdict.outcome)}[/]  {safe(str(verdict))}")


def _settled(follower: FollowerFigures) -> str:
    if follower.settling_time is not None:
        return f"{follower.settling_time:.2f}"
    return "[yellow]outside[/]" if follower.within_from is None else f"[yellow]since {follower.within_from:.2f}[/]"


def _worst(verdicts: Iterable[Verdict]) -> Iterator[Verdict]:
    """Return the verdict with the smallest margin on each expectation, as marked and otherwise."""
    for _, group in groupby(verdicts, key=lambda verdict: verdict.where):
        for _, same in groupby(sorted(group, key=_alike), key=_alike):
            yield min(same, key=lambda verdict: -math.inf if math.isnan(verdict.margin) else verdict.margin)


def _alike(verdict: Verdict) -> tuple[bool, bool]:
    return verdict.as_marked, verdict.judged


def _shown(value: float, digits: int) -> str:
    if not math.isfinite(value):  # a run cut short has no last fifth
        return "-"
    return f"{value:.{digits}f}" if abs(value) < 1e6 else f"{value:.3g}"
