"""The FMUs that are mutated: ten kinds of model description, of every version of FMI."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

KINDS: tuple[dict[str, Any], ...] = (
    {"fmi": "1.0"},
    {"fmi": "1.0", "interface": "model_exchange", "end_stop": 0.5, "units": "deg"},
    {"fmi": "2.0"},
    {"fmi": "2.0", "interface": "both", "units": "names", "discrete": True, "save": True},
    {"fmi": "2.0", "interface": "model_exchange", "initial": "parameters", "end_stop": 0.5, "step_event": True},
    {"fmi": "2.0", "fillers": 50, "structured": True, "units": "odd", "fixed_step": 0.01, "once": True},
    {"fmi": "3.0"},
    {"fmi": "3.0", "arrays": True, "event_mode": True, "early_return": "allowed", "intermediate_update": True},
    {"fmi": "3.0", "interface": "both", "types": "single", "discrete": True, "feedthrough": True, "compass": True},
    {"fmi": "3.0", "interface": "model_exchange", "initial": "parameters", "end_stop": 0.5, "tolerance": "1e-6"},
)
"""Options of `tests.stub.stub.make_fmu`."""


def seeds(make: Callable[..., Path]) -> tuple[bytes, ...]:
    """Return the bytes of an FMU of each kind."""
    return tuple(make(**kind).read_bytes() for kind in KINDS)
