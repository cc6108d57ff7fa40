"""The path that a leader is given."""

from __future__ import annotations

from cosim.scenario.reader.element import Element
from cosim.scenario.scenario import Trajectory


def trajectory(element: Element) -> Trajectory:
    """Read a trajectory."""
    waypoints = list(element.children("waypoint"))
    if bool(waypoints) == ("file" in element):
        raise element.error("a <trajectory> needs either waypoints or file=...")
    points: list[tuple[float, float, float]] = []
    for waypoint in waypoints:
        time, x, y = (waypoint.quantity(name, unit) for name, unit in (("at", "s"), ("x", "m"), ("y", "m")))
        if points and time <= points[-1][0]:
            raise waypoint.error(f"the waypoint at {time:.12g} s is not later than the one before it")
        points.append((time, x, y))
    return Trajectory(
        waypoints=tuple(points),
        file=element.path("file") if "file" in element else None,
        smoothing=element.not_negative("smoothing", "m") if "smoothing" in element else 0.0,
        where=element.where,
    )
