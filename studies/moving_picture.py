"""The moving picture of the README: a scenario of car-like robots as an animated SVG, drawn from its run.

    python studies/moving_picture.py

writes ``docs/figures/clmr_line.svg``. Poses, steering angles and wheelbases are to scale; the width of a body is not
part of a model. The picture follows the reader's light or dark theme.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from formation_controllers import CarLike
from lxml import etree
from numpy.typing import NDArray

import cosim

ROOT = Path(__file__).parents[1]
SCENARIO = ROOT / "scenarios" / "clmr_line.xml"
PICTURE = ROOT / "docs" / "figures" / "clmr_line.svg"

RATE = 8.0
"""Seconds of the run in a second of the picture."""
FRAME = 0.5
"""Time [s] in the run between two poses of the picture; in between the browser interpolates."""
SCALE = 20.0
"""Pixels a metre."""
MARGIN = 1.6
"""Around the paths [m]."""
WIDTH = 0.8
"""Of a body [m]."""

STYLE = """
  .ground { fill: none; stroke: #8884; stroke-width: 1 }
  .sight { stroke: #8888; stroke-width: 1; stroke-dasharray: 3 4 }
  .path { fill: none; stroke-width: 1.6; stroke-opacity: .55; stroke-linejoin: round }
  .tyre, text { fill: #24292f }
  .body { stroke: #24292f; stroke-width: 1.2 }
  text { font: 13px system-ui, sans-serif }
  @media (prefers-color-scheme: dark) { .tyre, text { fill: #d0d7de } .body { stroke: #d0d7de } }
"""
TITLE = "Four car-like robots take their places behind a virtual leader"
COLOURS = ("#4c8dd6", "#e0823d", "#3fa66b", "#c9588f")


def main() -> None:
    """Run the scenario and draw it."""
    with cosim.Simulation(cosim.read_scenario(SCENARIO)) as simulation:
        result = simulation.run()
        robots = simulation.setup.followers
        wheelbases = {r.name: r.vehicle.wheelbase for r in robots if isinstance(r.vehicle, CarLike)}
        leader_base = simulation.setup.leader.vehicle.wheelbase
    every = round(FRAME / result.attrs["step"])
    shown = result.isel(time=slice(None, None, every))
    poses = {name: shown["pose"].sel(robot=name).values for name in wheelbases}
    PICTURE.write_bytes(picture(shown["time"].values, shown["leader_pose"].values, leader_base, poses, wheelbases))
    print(f"{PICTURE.relative_to(ROOT)}: {PICTURE.stat().st_size / 1e3:.0f} kB")


def picture(
    time: NDArray[np.float64],
    leader: NDArray[np.float64],
    leader_base: float,
    poses: dict[str, NDArray[np.float64]],
    wheelbases: dict[str, float],
) -> bytes:
    """Return the animated SVG of a leader and its followers from their poses (T, 4) over the time (T,)."""
    points = np.concatenate([leader[:, :2], *(pose[:, :2] for pose in poses.values())])
    low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
    width, height = SCALE * (high - low)
    duration = f"{(time[-1] - time[0]) / RATE:g}s"

    def place(pose: NDArray[np.float64]) -> NDArray[np.float64]:
        return SCALE * np.column_stack([pose[:, 0] - low[0], high[1] - pose[:, 1]])

    svg = _element(None, "svg", xmlns="http://www.w3.org/2000/svg", viewBox=f"0 0 {width:.0f} {height:.0f}")
    svg.set("role", "img")
    _element(svg, "title").text = TITLE
    _element(svg, "style").text = STYLE
    _ground(svg, low, high)
    at = place(leader)
    for (name, pose), colour in zip(poses.items(), COLOURS, strict=True):
        robot = place(pose)
        _path(svg, robot, colour, duration)
        line = _element(svg, "line", **{"class": "sight"})
        for attribute, values in (
            ("x1", robot[:, 0]),
            ("y1", robot[:, 1]),
            ("x2", at[:, 0]),
            ("y2", at[:, 1]),
        ):
            _animate(line, attribute, values, duration)
        _car(svg, robot, pose, wheelbases[name], duration, fill=colour)
    _car(svg, at, leader, leader_base, duration, fill="none", stroke_dasharray="3 3")
    _clock(svg, time, width, height, duration)
    return bytes(etree.tostring(svg, encoding="utf-8", pretty_print=True))


def _ground(svg: etree._Element, low: NDArray[np.float64], high: NDArray[np.float64]) -> None:
    """Draw lines every five metres."""
    width, height = SCALE * (high - low)
    lines = [f"M{SCALE * (x - low[0]):.0f} 0V{height:.0f}" for x in _fives(low[0], high[0])]
    lines += [f"M0 {SCALE * (high[1] - y):.0f}H{width:.0f}" for y in _fives(low[1], high[1])]
    _element(svg, "path", d="".join(lines), **{"class": "ground"})


def _fives(low: float, high: float) -> Iterable[int]:
    return range(5 * math.ceil(low / 5), math.floor(high) + 1, 5)


def _path(svg: etree._Element, robot: NDArray[np.float64], colour: str, duration: str) -> None:
    """Draw the way of a robot as it goes: a dash as long as the path is pulled along it."""
    d = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in robot)
    path = _element(svg, "path", d=d, stroke=colour, pathLength="1", **{"class": "path"})
    path.set("stroke-dasharray", "1 1")
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(robot, axis=0).T))])
    _animate(path, "stroke-dashoffset", 1.0 - length / length[-1], duration, digits=4)


def _car(
    svg: etree._Element,
    robot: NDArray[np.float64],
    pose: NDArray[np.float64],
    wheelbase: float,
    duration: str,
    **look: str,
) -> None:
    """Draw a robot, whose place is the midpoint of its rear axle."""
    moved = _element(svg, "g")
    _transform(moved, "translate", (f"{x:.1f} {y:.1f}" for x, y in robot), duration)
    car = _element(moved, "g")
    _transform(car, "rotate", (f"{-angle:.1f}" for angle in np.degrees(np.unwrap(pose[:, 2]))), duration)
    base, half = SCALE * wheelbase, SCALE * WIDTH / 2
    wheel = 0.3 * half
    body = _element(car, "rect", x=f"{-0.25 * base:.1f}", y=f"{-half:.1f}", rx="4", **{"class": "body"})
    body.set("width", f"{1.5 * base:.1f}")
    body.set("height", f"{2 * half:.1f}")
    for name, value in look.items():
        body.set(name.replace("_", "-"), value)
    for along, steered in ((0.0, False), (base, True)):
        for side in (-half, half):
            axle = _element(car, "g", transform=f"translate({along:.1f} {side:.1f})")
            if steered:
                axle = _element(axle, "g")
                _transform(axle, "rotate", (f"{-angle:.1f}" for angle in np.degrees(pose[:, 3])), duration)
            tyre = _element(axle, "rect", x=f"{-2 * wheel:.1f}", y=f"{-wheel / 1.5:.1f}", rx="1", **{"class": "tyre"})
            tyre.set("width", f"{4 * wheel:.1f}")
            tyre.set("height", f"{2 * wheel / 1.5:.1f}")


def _clock(svg: etree._Element, time: NDArray[np.float64], width: float, height: float, duration: str) -> None:
    """Write the time of the run, every five seconds, and how fast it is shown."""
    marks = np.arange(time[0], time[-1], 5.0)
    for mark in marks:
        text = _element(svg, "text", x="12", y=f"{height - 12:.0f}", visibility="hidden")
        text.text = f"t = {mark:.0f} s"
        seen = ((time >= mark) & (time < mark + 5.0)) | ((mark == marks[-1]) & (time >= mark))
        starts = np.flatnonzero(np.diff(seen.astype(int), prepend=-1))
        animation = _element(text, "animate", attributeName="visibility", calcMode="discrete", dur=duration)
        animation.set("values", ";".join("visible" if seen[i] else "hidden" for i in starts))
        animation.set("keyTimes", ";".join(f"{i / (len(time) - 1):.4f}".rstrip("0").rstrip(".") for i in starts))
        animation.set("repeatCount", "indefinite")
    note = _element(svg, "text", x=f"{width - 12:.0f}", y=f"{height - 12:.0f}")
    note.set("text-anchor", "end")
    note.text = f"{RATE:g} times as fast as real time; lines every 5 m"


def _animate(
    parent: etree._Element, attribute: str, values: NDArray[np.float64], duration: str, digits: int = 1
) -> None:
    animation = _element(parent, "animate", attributeName=attribute, dur=duration, repeatCount="indefinite")
    animation.set("values", ";".join(f"{value:.{digits}f}" for value in values))


def _transform(parent: etree._Element, kind: str, values: Iterable[str], duration: str) -> None:
    animation = _element(parent, "animateTransform", attributeName="transform", type=kind, dur=duration)
    animation.set("values", ";".join(values))
    animation.set("repeatCount", "indefinite")


def _element(parent: etree._Element | None, tag: str, **attributes: str) -> etree._Element:
    if parent is None:
        return etree.Element(tag, attributes)
    return etree.SubElement(parent, tag, attributes)


if __name__ == "__main__":
    main()
