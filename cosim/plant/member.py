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
        Which number of the block of inputs or outputs it is; -1 if nothing plays the role, which is then not a number.
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
        The FMU to start, with all that its start needs.
    inputs, outputs : tuple of Link
        Its roles.
    pose : tuple of float
        The initial pose, as the first of the outputs must be at the start; empty if it does not matter.
    isolated : bool
        Whether it runs in a process of its own.
    needs_tool : bool
        Whether it says that it needs another program.
    usual_step : float
        The step [s] of its default experiment, if it takes steps of constant length only; else 0.
    where : Location or None
        Who asks for it.
    columns : tuple of int
        Where its outputs stand in a row of the fleet's state; one after the other if nothing is said.
    """

    spec: PlantSpec
    inputs: tuple[Link, ...]
    outputs: tuple[Link, ...]
    pose: tuple[float, ...] = ()
    isolated: bool = False
    needs_tool: bool = False
    usual_step: float = 0.0
    where: Location | None = None
    columns: tuple[int, ...] = ()
