"""Where followers look from, and where they should be, from a result alone."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.results.result import Result
from cosim.vehicle.kinds import kind_named

Floats = NDArray[np.float64]


def sight_ahead(result: Result, row: int) -> float:
    """Return how far ahead of the reference point range and bearing of a vehicle are measured from [m]: (7), (54)."""
    try:
        kind = kind_named(str(result["vehicle_kind"].values[row]))
        vehicle = kind.vehicle(**{field: _geometry(result, kind.name, field, row) for field in kind.geometry})
    except (InputError, KeyError, ValueError):  # of an earlier version, or of a package that is not here
        return 0.0
    formation = getattr(vehicle, "formation", None)
    return 0.0 if formation is None or formation.steering == "none" else float(formation.length)


def _geometry(result: Result, kind: str, field: str, row: int) -> Any:
    name = f"vehicle_{field}_of_{kind}"
    value = result[name if name in result else f"vehicle_{field}"].values[row]
    return str(value) if isinstance(value, str) else float(value)


def sight_points(result: Result) -> Floats:
    """Return the points (T, N, 2) that the followers' ranges and bearings are measured from [m]."""
    poses = result["pose"].values[..., :3]
    ahead = np.array([sight_ahead(result, row) for row in range(1, len(result.robots) + 1)])
    points: Floats = poses[..., :2] + ahead[:, np.newaxis] * np.stack(
        [np.cos(poses[..., 2]), np.sin(poses[..., 2])], axis=-1
    )
    return points


def desired_points(result: Result) -> Floats:
    """Return where these points should be (T, N, 2), at the desired range and bearing [m]; NaN if unknown."""
    points = sight_points(result)
    if not {"range", "range_error", "bearing_error"} <= result.data_vars.keys():
        return np.full_like(points, np.nan)
    leader = result["leader_pose"].values[:, np.newaxis, :2]
    x, y = np.moveaxis(leader - points, -1, 0)
    direction = np.arctan2(y, x) - result.of_robots("bearing_error")
    distance = result.of_robots("range") - result.of_robots("range_error")
    desired: Floats = leader - distance[..., np.newaxis] * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    return desired
