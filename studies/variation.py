"""Runs of a scenario with changes and several seeds, and the worst figures of each: shared by the studies here."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

import cosim
from cosim.results.summary import summarise
from cosim.scenario.edits import Change, set_seed

ROOT = Path(__file__).resolve().parent.parent
FIGURES = ROOT / "docs" / "figures"
SCENARIOS = ROOT / "scenarios"

HEADER = ("settled", "last after", "range", "bearing", "drive gain", "det R", "steering")
"""Settled followers, time of the last one, errors (RMS), and the extremes of drive gain, det R and steering angle."""


@dataclass(frozen=True)
class Outcome:
    """The worst follower of a run, or the worst run of several.

    Attributes
    ----------
    followers, settled : int
        How many followers there are, and how many of them settle, as `cosim.results.summary` defines it.
    last : float
        When the last one has settled [s]; infinite if not all do.
    range_rms, bearing_rms : float
        Root mean squares over the last fifth of the horizon [m], [rad].
    drive_gain, det_R : float
        The least over the run; a run that is negative here has left the domain of the theory.
    steering : float
        Largest magnitude of the steering angle [rad].
    diverged : int
        Runs that did not reach the horizon; the other figures leave them out.
    """

    followers: int
    settled: int
    last: float
    range_rms: float
    bearing_rms: float
    drive_gain: float
    det_R: float
    steering: float
    diverged: int = 0

    def cells(self) -> tuple[str, ...]:
        """Return the cells of a table's row, as `HEADER` names them."""
        if not self.followers:
            return ("diverged", *("",) * (len(HEADER) - 1))
        last = f"{self.last:.0f} s" if math.isfinite(self.last) else "-"
        note = f" ({self.diverged} diverged)" if self.diverged else ""
        return (
            f"{self.settled} of {self.followers}{note}",
            last,
            f"{self.range_rms:.3f} m",
            f"{math.degrees(self.bearing_rms):.2f}°",
            number(self.drive_gain),
            number(self.det_R),
            f"{math.degrees(self.steering):.0f}°",
        )


def gain(**values: float) -> list[str]:
    """Return the changes that set gains of the controller of a scenario, also gains that it leaves out."""
    return [f'controller/gain[@name="{name}"]/@value={value:g}' for name, value in values.items()]


def parameter(name: str, value: str) -> list[str]:
    """Return the change that sets a parameter of every plant of a scenario."""
    return [f'//parameter[@name="{name}"]/@value={value}']


def outcome(scenario: Path, changes: Sequence[str | Change], seed: int) -> Outcome:
    """Run a scenario with changes and one seed."""
    read = cosim.read_scenario(scenario, [*changes, set_seed(seed)])
    try:
        result = cosim.run(read)
    except cosim.SimulationError:
        return Outcome(0, 0, math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, diverged=1)
    figures = summarise(read, result).followers
    times = [follower.settling_time for follower in figures]
    settled = [time for time in times if time is not None]
    pose = result["pose"].values
    steering = pose[..., 3] - pose[..., 2] if "theta_1" in result["pose_component"].values else pose[..., 3]
    return Outcome(
        followers=len(figures),
        settled=len(settled),
        last=max(settled) if len(settled) == len(times) else math.inf,
        range_rms=max(follower.range_rms for follower in figures),
        bearing_rms=max(follower.bearing_rms for follower in figures),
        drive_gain=float(result["drive_gain"].min()),
        det_R=float(result["det_R"].min()),
        steering=float(np.abs(steering).max()),
    )


def worst(outcomes: Iterable[Outcome]) -> Outcome:
    """Return the worst of several runs, figure by figure; runs that diverged are only counted."""
    runs = list(outcomes)
    whole = [run for run in runs if not run.diverged]
    if not whole:
        return runs[0]
    return Outcome(
        followers=whole[0].followers,
        settled=min(run.settled for run in whole),
        last=max(run.last for run in whole),
        range_rms=max(run.range_rms for run in whole),
        bearing_rms=max(run.bearing_rms for run in whole),
        drive_gain=min(run.drive_gain for run in whole),
        det_R=min(run.det_R for run in whole),
        steering=max(run.steering for run in whole),
        diverged=len(runs) - len(whole),
    )


def number(value: float) -> str:
    """Return a number with two digits, large ones without decimals."""
    if abs(value) >= 100:
        return f"{float(f'{value:.2g}'):,.0f}".replace(",", " ").replace("-", "−")
    return f"{value:.2f}".replace("-", "−")


def save(figure: Figure, name: str, dpi: float = 90) -> None:
    """Write a figure to docs/figures as PNG with 256 colours, which suffice for lines and take a third of the space."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    picture = Image.open(buffer).convert("RGB").quantize(256)
    FIGURES.mkdir(exist_ok=True)
    picture.save(FIGURES / f"{name}.png", optimize=True)


def row(*cells: str) -> str:
    """Return a row of a Markdown table."""
    return "| " + " | ".join(cells) + " |"


def heading(*cells: str) -> str:
    """Return the first two rows of a Markdown table."""
    return row(*cells) + "\n" + "|" + "---|" * len(cells)
