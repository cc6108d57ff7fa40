"""The groups in which a reader finds the signals of a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

GROUPS = (
    "errors",
    "commands",
    "motion",
    "place in the formation",
    "estimates",
    "sensors",
    "leader",
    "singularities",
    "other telemetry",
)
"""Groups, in the order in which they are shown."""

_NAMES: Mapping[str, str] = {
    **dict.fromkeys(("range_error", "bearing_error"), "errors"),
    **dict.fromkeys(("torque", "command", "torque_command", "command_command"), "commands"),
    **dict.fromkeys(("pose", "velocity"), "motion"),
    **dict.fromkeys(("range", "bearing", "desired_range", "desired_bearing"), "place in the formation"),
}
_BEGINNINGS = {"measured_": "sensors", "leader_": "leader", "disturbance": "commands"}


def group_of(name: str, attributes: Mapping[Any, Any]) -> str:
    """Return the group of a signal, by its name in the result and its attributes there."""
    if name in _NAMES:
        return _NAMES[name]
    for beginning, group in _BEGINNINGS.items():
        if name.startswith(beginning):
            return group
    if attributes.get("singular_at_zero"):
        return "singularities"
    return "estimates" if name.endswith("_estimate") else "other telemetry"
