"""A plant of a fleet: its specification, and the numbers that play its roles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cosim.errors import Location
from cosim.plant.spec import PlantSpec


@dataclass(frozen=True)
class Link:
    """A role that a number of an FMU plays.

    Attributes
    ----------
    name, unit : str
        The role and its unit.
    place : int
        Index of the number in the block of inputs or outputs; -1 if no number plays the role.
    scale, offset : float
        ``value in the role's unit = scale * number + offset``.
    bound : float
        Magnitude in the role's unit beyond which the motion has diverged.
    resolution : float
        Largest rounding error of a whole number, in the role's unit.
    """

    name: str
    unit: str
    place: int
    scale: float
    offset: float
    bound: float = np.inf
    resolution: float = 0.0


@dataclass(frozen=True)
class Member:
    """A plant of a fleet.

    Attributes
    ----------
    spec : PlantSpec
        The FMU to start, with all values for its start.
    inputs, outputs : tuple of Link
        Its roles.
    pose : tuple of float
        The initial pose, which the first outputs must show at the start; empty for any pose.
    isolated : bool
        Whether it runs in another process than the harness's, with the other robots of its FMU.
    alone : bool
        Whether that process holds no other robot.
    needs_tool : bool
        Whether the FMU states that it needs another program.
    usual_step : float
        The step [s] of its default experiment, if it takes steps of constant length only; else 0.
    where : Location or None
        Place in the scenario that asks for it.
    columns : tuple of int
        Columns of its outputs in a row of the fleet's state; empty: one after the other.
    """

    spec: PlantSpec
    inputs: tuple[Link, ...]
    outputs: tuple[Link, ...]
    pose: tuple[float, ...] = ()
    isolated: bool = False
    alone: bool = False
    needs_tool: bool = False
    usual_step: float = 0.0
    where: Location | None = None
    columns: tuple[int, ...] = ()
