"""The interface between a controller and the program that runs it."""

from __future__ import annotations

import numbers
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from formation_controllers.errors import ControllerError
from formation_controllers.vehicles import Vehicle, is_positive, vehicle_fault

Floats: TypeAlias = NDArray[np.float64]

INTERFACE_VERSION: Final = "1.4"
"""Version of the interface: of the types below and of `formation_controllers.controller.Controller`.

It is not the package's. The minor number grows when something is added that older controllers need not know,
the major number when they must be rewritten: a controller can be used if it speaks the same major and no
later minor number. 1.1 added to 1.0: gains of each follower's own, laws that need
measured velocities, and how near to zero a signal tells of a singularity. 1.3 added `CompiledTick`, 1.4
`CompiledStart`.
"""

MEASUREMENTS: Final = ("velocity",)
"""Measurements that a law can need besides poses, `Controller.needs`."""


@dataclass(frozen=True)
class Team:
    """Facts that a controller gets once.

    Parameters
    ----------
    vehicle
        The vehicle that every follower is: any object that states the facts of `Vehicle`.
    size
        Number N of followers.
    period
        Time between two ticks [s].

    Raises
    ------
    ControllerError
        If the vehicle lacks a fact that it must state, the size is not a positive whole number or the period not a
        positive time.
    """

    vehicle: Vehicle
    size: int
    period: float

    def __post_init__(self) -> None:
        fault = vehicle_fault(self.vehicle)
        if fault:
            raise ControllerError(f"the vehicle is {self.vehicle!r}: {fault}")
        if not isinstance(self.size, numbers.Integral) or isinstance(self.size, bool):
            raise ControllerError(f"the size of the team is {self.size!r}: expected a whole number")
        if self.size < 1:
            raise ControllerError(f"the team has {self.size} followers: it needs at least one")
        if not is_positive(self.period):
            raise ControllerError(f"the period is {self.period} s: it must be a positive time")
        object.__setattr__(self, "period", float(self.period))  # laws compute with doubles, not with fractions


class Leader(NamedTuple):
    """The virtual leader at this tick, as if it were the followers' kind of vehicle.

    Attributes
    ----------
    pose, velocity : ndarray
        One number for each entry of the vehicle's `pose` and `velocity`.
    acceleration : ndarray or None
        Rates of the velocities, if they are known.
    """

    pose: Floats
    velocity: Floats
    acceleration: Floats | None = None


class Desired(NamedTuple):
    """Desired range [m] and bearing [rad] of every follower at this tick and two derivatives, each (N, 2)."""

    q: Floats
    q_dot: Floats
    q_ddot: Floats


class TickInputs(NamedTuple):
    """The inputs of a team at a tick: the arrays of `Controller.step`, checked.

    Attributes
    ----------
    pose, velocity : ndarray
        Poses of the followers and their measured velocities, NaN for a law that does not need these.
    leader_pose, leader_velocity, leader_acceleration : ndarray
        The leader; its acceleration is zero where it is not known.
    q_d, q_d_dot, q_d_ddot : ndarray
        Desired range and bearing and their derivatives.
    """

    pose: Floats
    velocity: Floats
    leader_pose: Floats
    leader_velocity: Floats
    leader_acceleration: Floats
    q_d: Floats
    q_d_dot: Floats
    q_d_ddot: Floats


class CompiledTick(NamedTuple):
    """A tick of a law as compiled code calls it: ``function(inputs, own, commands)``.

    Attributes
    ----------
    function : callable
        Fills the commands (N, C) of a team at a tick and its telemetry record, and advances its state by one period;
        returns nothing. Compiled with Numba, or plain Python where Numba is switched off.
    own : tuple
        Its second argument: numbers, arrays and tuples of these, the arrays always the same ones.
    """

    function: Callable[[TickInputs, Any, Floats], None]
    own: Any


class CompiledStart(NamedTuple):
    """The start of a law as compiled code, or a translation to C, calls it: ``function(inputs, own)``.

    Attributes
    ----------
    function : callable
        Sets the state of a team at time zero, given the inputs of the first tick and a state of zeros; returns nothing.
    own : tuple
        Its second argument, that of `CompiledTick`.
    prepared : tuple of str
        States that the function leaves as it finds them: `Controller.start` sets them from gains and desired places.
    """

    function: Callable[[TickInputs, Any], None]
    own: Any
    prepared: tuple[str, ...] = ()


@dataclass(frozen=True)
class Signal:
    """One telemetry signal: an array of shape (N,), or (N, len(components)) if it has components.

    Attributes
    ----------
    name, unit, description : str
        What it is.
    components : tuple of str
        Names of its components, if it has any.
    singular_at_zero : str
        The singularity where the signal is zero, as a clause: "the law is singular". A change of its sign
        then means that a step has jumped over a singularity. Empty if zero is a value like any other.
    singular_below : float
        Magnitude below which the signal is near that singularity. Zero: only changes of sign count.
    """

    name: str
    unit: str
    description: str
    components: tuple[str, ...] = ()
    singular_at_zero: str = ""
    singular_below: float = 0.0
