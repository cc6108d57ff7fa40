"""A kind of vehicle: all its facts for the harness, in one object.

`Kind` states the roles of a plant of the kind with their units, its geometry for controllers, the words by which a
foreign FMU is recognised, how two plants are compared, how it moves along a path, and its outline.
`cosim.vehicle.kinds` finds the kinds that are installed. No other module knows how many entries a pose has.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from formation_controllers.vehicles import Vehicle

from cosim.vehicle.evidence import Evidence, nothing_against
from cosim.vehicle.outline import Outline
from cosim.vehicle.path import Course, Floats, Motion, PathMotion
from cosim.vehicle.words import Recognition, Series, words


@dataclass(frozen=True)
class Role:
    """The purpose of a variable: its name, the causality that it must have, and its unit.

    A role without a unit is played by an enumeration, all others by a real variable. A plant may lack an optional role.
    Its meaning states where zero is and which way is positive. `items` are the items of the enumeration.
    """

    name: str
    causality: str
    unit: str
    optional: bool = False
    meaning: str = ""
    items: tuple[str, ...] = ()


def units_of(roles: Iterable[Role]) -> dict[str, str]:
    """Return the units of roles, by name."""
    return {role.name: role.unit for role in roles}


@dataclass(frozen=True)
class Recognised:
    """Words and rules by which the variables of a foreign FMU are recognised as roles of a vehicle.

    Attributes
    ----------
    by_role : dict
        Words that are evidence for a role, besides its own name.
    order : dict
        Words of a description that distinguish the commands of an array.
    conventions : dict
        By the role, a part of a regular expression: words of a description that uses another convention.
    refusal : callable
        Returns why an FMU is clearly another kind of vehicle; empty if it is not.
    """

    by_role: Mapping[str, Recognition] = field(default_factory=dict)
    order: Mapping[str, frozenset[str]] = field(default_factory=dict)
    conventions: Mapping[str, str] = field(default_factory=dict)
    refusal: Callable[[Evidence], str] = nothing_against


@dataclass(frozen=True)
class Response:
    """A command that alone moves a role from rest, and its direction: up (1) or down (-1)."""

    command: str
    role: str
    sign: int


@dataclass(frozen=True)
class Excitation:
    """Commands that move a plant well in a comparison: one course of driving and one of turning.

    Attributes
    ----------
    size : tuple of float
        Amplitudes of driving and turning in the first attempt, in the units of the commands.
    commands : callable
        Returns the commands (T, commands) for drive and turning (T, 2).
    turned : callable
        Returns from states (T, entries) the angle [rad] that turning changes. It must stay far from 90 degrees.
    """

    size: tuple[float, float]
    commands: Callable[[Floats], Floats]
    turned: Callable[[Floats], Floats]


@dataclass(frozen=True)
class OnPath:
    """How a vehicle moves along a path.

    Attributes
    ----------
    course : callable
        Returns from a vehicle and its state (entries) its course on a path.
    state : callable
        Returns from a vehicle and a course the state (entries) that it has there.
    motion : callable
        Returns from a vehicle and a motion along a path its own motion over time.
    steering_length : callable
        Returns the length of a vehicle [m] that, with its steering angle, gives the curvature; None without such an
        angle.
    """

    course: Callable[[Any, Sequence[float]], Course]
    state: Callable[[Any, Course], tuple[float, ...]]
    motion: Callable[[Any, PathMotion], Motion]
    steering_length: Callable[[Any], float | None]


@dataclass(frozen=True)
class ExampleLaw:
    """The control law of a first scenario, with gains that work."""

    id: str
    name: str
    package: str
    version: str
    gains: Mapping[str, str]


ADAPTIVE_PID = ExampleLaw(
    id="pid",
    name="neural-adaptive-pid",
    package="formation-controllers",
    version="~=0.1.0",
    gains={"K_p": "40", "Lambda_0": "1", "Lambda_1": "0.05", "gamma_w": "0.1", "W_m": "100", "guard": "0.1"},
)


@dataclass(frozen=True)
class Example:
    """Values with which ``formation new`` writes a scenario that meets its expectations.

    Attributes
    ----------
    plant : str
        The id of its plant.
    leader : dict
        The commands of the leader, as in a scenario.
    length : float
        How far behind the reference point a follower's body may reach [m].
    parameter : tuple of str
        Name and value of a parameter of the plant.
    limited, limit : str
        The torque of which a peak is expected, and the largest one; empty for none.
    source : str
        The plant's attribute, such as ``fmu="my_robot.fmu"``; empty for the built-in model of the kind's name.
    law : ExampleLaw
        The control law.
    """

    plant: str
    leader: Mapping[str, str]
    length: float
    parameter: tuple[str, str]
    limited: str = ""
    limit: str = ""
    source: str = ""
    law: ExampleLaw = ADAPTIVE_PID


@dataclass(frozen=True, eq=False)
class Kind:
    """A kind of vehicle.

    Attributes
    ----------
    name, title : str
        Its name in scenarios, and its name in texts.
    pose, velocity, command : tuple of Role
        Outputs of a plant, and its commands. The pose begins with x, y and a heading.
    geometry : dict
        Arguments of `vehicle`, each with the parameter that holds it.
    vehicle : callable
        Returns the geometry that controllers know.
    disturbance : tuple of Role
        Other inputs, by which a scenario can disturb the vehicle.
    recognised : Recognised
        How a foreign FMU is recognised.
    probe : tuple of float
        An initial pose for comparisons, in which every entry counts, so that a wrong sign or offset shows at once.
    responses : tuple of Response
        Movements that a short drive of a foreign FMU must show.
    excitation : Excitation or None
        The commands of a comparison; without it, the user must give commands.
    on_path : OnPath or None
        Its motion along a path; without it, the vehicle leads no other kind, and along no trajectory.
    example : Example or None
        Values of a first scenario; without it, ``formation new`` writes none.
    outline : callable or None
        Returns the bodies and wheels of a vehicle, see `cosim.vehicle.outline`; without it, the vehicle has no body,
        and ``<distance of="bodies">`` is refused.
    """

    name: str
    title: str
    pose: tuple[Role, ...]
    velocity: tuple[Role, ...]
    command: tuple[Role, ...]
    geometry: Mapping[str, Role]
    vehicle: Callable[..., Vehicle]
    disturbance: tuple[Role, ...] = ()
    recognised: Recognised = field(default_factory=Recognised)
    probe: tuple[float, ...] = ()
    responses: tuple[Response, ...] = ()
    excitation: Excitation | None = None
    on_path: OnPath | None = None
    example: Example | None = None
    outline: Callable[[Any], Outline] | None = None

    @property
    def roles(self) -> tuple[Role, ...]:
        """All roles."""
        return (*self.pose, *self.velocity, *self.command, *self.disturbance, *self.geometry.values())

    @property
    def states(self) -> tuple[Role, ...]:
        """Pose and velocities: the outputs of a plant."""
        return (*self.pose, *self.velocity)

    @cached_property
    def series(self) -> tuple[Series, ...]:
        """The arrays of a foreign FMU that may hold roles one after the other."""
        pose, command = names(self.pose), names(self.command)
        commands = "tau torque torques moment moments u input inputs" + " command commands" * (not self.takes_torques)
        return (
            Series(words("pose"), (len(pose),), pose, telling=True),
            Series(words("q eta state states coordinates configuration"), (len(pose),), pose),
            *((Series(words("pose"), (3,), pose[:3], telling=True),) if len(pose) > 3 else ()),
            Series(words("position pos location"), (2, 3), pose[:2], telling=True),
            Series(words("p"), (2, 3), pose[:2]),
            Series(words(commands), (len(command),), command),
        )

    @property
    def takes_torques(self) -> bool:
        """Whether all commands are torques."""
        return all(role.unit == "N.m" for role in self.command)

    @property
    def command_word(self) -> str:
        """What one of its commands is called: a torque, or a command if not all are torques."""
        return "torque" if self.takes_torques else "command"


def names(roles: Sequence[Role]) -> tuple[str, ...]:
    """Return the names of roles."""
    return tuple(role.name for role in roles)


def disturbances(*angles: str) -> tuple[Role, ...]:
    """Return the disturbances tau_d1 of (1), which oppose motion where they are positive."""
    units = {"x": "N", "y": "N"} | dict.fromkeys(angles, "N.m")
    return tuple(
        Role(f"tau_d_{name}", "input", unit, optional=True, meaning=f"disturbance along {name}, opposing motion")
        for name, unit in units.items()
    )
