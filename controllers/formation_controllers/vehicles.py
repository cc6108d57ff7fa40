"""Facts about vehicles that a controller gets, and the three kinds that this package brings.

A vehicle is any object that states the facts of `Vehicle`. A law of range and bearing needs two more, which a vehicle
may state or not: its `FormationGeometry`, and for a law that returns torques its `TorqueMap`.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple, Protocol

from formation_controllers.errors import ControllerError, unknown

DRIVES: Final = ("as_printed", "front_wheel", "rear_wheel")
"""Variants of the third row of the input matrix B1 in (56)."""

STEERINGS: Final = ("none", "angle", "heading")
"""How the steering angle follows from a pose, see `FormationGeometry`."""

TORQUE_FORMS: Final = (*DRIVES, "wheels")
"""Kinds of the two torques of a vehicle, see `TorqueMap`."""


class Entry(NamedTuple):
    """One number of a pose, a velocity, a command or a geometry.

    Attributes
    ----------
    name : str
        Its name.
    unit : str
        Its unit; empty for an entry that is no number, such as the drive of a car-like robot.
    """

    name: str
    unit: str


class Vehicle(Protocol):
    """The facts that every vehicle states.

    Attributes
    ----------
    kind : str
        Its kind, by which a law says whom it serves.
    pose : tuple of Entry
        Entries of a pose: x [m], y [m] and a heading [rad] come first.
    velocity : tuple of Entry
        Its pseudo-velocities.
    command : tuple of Entry
        The outputs of a law: torques, or speeds and angles of a kinematic vehicle.
    geometry : tuple of Entry
        Attributes of the vehicle that hold its geometry.
    """

    @property
    def kind(self) -> str: ...  # noqa: D102 (stated above)
    @property
    def pose(self) -> tuple[Entry, ...]: ...  # noqa: D102
    @property
    def velocity(self) -> tuple[Entry, ...]: ...  # noqa: D102
    @property
    def command(self) -> tuple[Entry, ...]: ...  # noqa: D102
    @property
    def geometry(self) -> tuple[Entry, ...]: ...  # noqa: D102
    def __hash__(self) -> int: ...


@dataclass(frozen=True)
class FormationGeometry:
    """The facts by which a vehicle sees its leader, (7), (8), (54), (55): a vehicle's attribute `formation`.

    Parameters
    ----------
    steering
        Source of the steering angle. ``angle``: the fourth entry of the pose is that angle, against the body, and omega
        is its rate. ``heading``: the fourth entry is the heading of the body that steers, and omega is that heading's
        rate. ``none``: there is no such angle, and omega is the rate of the heading, the third entry.
    length
        Distance [m] from the reference point ahead to the point that range and bearing are measured from: wheelbase or
        hitch length. A vehicle without a steering angle measures from its reference point; the length is then only
        compared with ranges, such as half its track.

    Raises
    ------
    ControllerError
        If the steering is unknown or the length not positive.
    """

    steering: str
    length: float

    def __post_init__(self) -> None:
        if not (isinstance(self.steering, str) and self.steering in STEERINGS):
            raise ControllerError(unknown("steering", self.steering, STEERINGS))
        _require_length("length", self.length)


@dataclass(frozen=True)
class TorqueMap:
    """The effect of a vehicle's two torques on (v, omega): B2 of (3). A vehicle's fact `torques`.

    Parameters
    ----------
    form
        ``as_printed``, ``front_wheel`` or ``rear_wheel``: a drive torque as in `CarLike` and a steering torque;
        ``wheels``: the torques of a right and a left wheel.
    wheel_radius, half_track
        Of the wheels [m]; not used by other forms.

    Raises
    ------
    ControllerError
        If the form is unknown, or a length of the wheels is not positive.
    """

    form: str
    wheel_radius: float = 1.0
    half_track: float = 1.0

    def __post_init__(self) -> None:
        if not (isinstance(self.form, str) and self.form in TORQUE_FORMS):
            raise ControllerError(unknown("form of torques", self.form, TORQUE_FORMS))
        _require_length("wheel radius", self.wheel_radius)
        _require_length("half track", self.half_track)


V_OMEGA: Final = (Entry("v", "m/s"), Entry("omega", "rad/s"))
WHEEL_TORQUES: Final = (Entry("tau_right", "N.m"), Entry("tau_left", "N.m"))
X_Y: Final = (Entry("x", "m"), Entry("y", "m"))


def names(entries: Sequence[Entry]) -> tuple[str, ...]:
    """Return the names of some entries."""
    return tuple(entry.name for entry in entries)


@dataclass(frozen=True)
class CarLike:
    """Car-like robot; its pose is (x, y, psi, gamma): rear axle [m], heading [rad], steering angle [rad].

    Parameters
    ----------
    wheelbase
        Distance a between the axles [m].
    drive
        Where the first torque acts, that is the first column of B1 in (56): ``as_printed`` (cos psi, sin psi,
        a sin psi, 0), ``front_wheel`` (cos(psi + gamma), sin(psi + gamma), a sin gamma, 0) or ``rear_wheel``
        (cos psi, sin psi, 0, 0).

    Raises
    ------
    ControllerError
        If the wheelbase is not a positive length or the drive is unknown.
    """

    wheelbase: float
    drive: str = "as_printed"

    kind: ClassVar[str] = "car_like"
    pose: ClassVar[tuple[Entry, ...]] = (*X_Y, Entry("psi", "rad"), Entry("gamma", "rad"))
    velocity: ClassVar[tuple[Entry, ...]] = V_OMEGA
    command: ClassVar[tuple[Entry, ...]] = (Entry("tau_drive", "N.m"), Entry("tau_steer", "N.m"))
    geometry: ClassVar[tuple[Entry, ...]] = (Entry("wheelbase", "m"), Entry("drive", ""))
    pose_components: ClassVar[tuple[str, ...]] = names(pose)

    def __post_init__(self) -> None:
        _require_length("wheelbase", self.wheelbase)
        if not (isinstance(self.drive, str) and self.drive in DRIVES):
            raise ControllerError(unknown("drive", self.drive, DRIVES))

    @property
    def formation(self) -> FormationGeometry:
        """It sees the leader from its front axle, relative to its steered wheel."""
        return FormationGeometry("angle", self.wheelbase)

    @property
    def torques(self) -> TorqueMap:
        """A drive and a steering torque."""
        return TorqueMap(self.drive)


@dataclass(frozen=True)
class TractorTrailer:
    """Tractor with a trailer hitched on its axle; its pose is (x, y, theta_1, theta_0).

    That is the midpoint of the trailer's axle [m], the heading of the trailer and the heading of the tractor
    [rad]. The torques are those of the tractor's right and left wheel, the columns of B1 in (57).

    Parameters
    ----------
    hitch_length
        Distance d from the trailer's axle to the tractor's [m].
    wheel_radius
        Radius r of the tractor's wheels [m].
    half_track
        Half the distance 2b between the tractor's wheels [m].

    Raises
    ------
    ControllerError
        If one of them is not a positive length.
    """

    hitch_length: float
    wheel_radius: float
    half_track: float

    kind: ClassVar[str] = "tractor_trailer"
    pose: ClassVar[tuple[Entry, ...]] = (*X_Y, Entry("theta_1", "rad"), Entry("theta_0", "rad"))
    velocity: ClassVar[tuple[Entry, ...]] = V_OMEGA
    command: ClassVar[tuple[Entry, ...]] = WHEEL_TORQUES
    geometry: ClassVar[tuple[Entry, ...]] = (
        Entry("hitch_length", "m"),
        Entry("wheel_radius", "m"),
        Entry("half_track", "m"),
    )
    pose_components: ClassVar[tuple[str, ...]] = names(pose)

    def __post_init__(self) -> None:
        _require_length("hitch length", self.hitch_length)
        _require_length("wheel radius", self.wheel_radius)
        _require_length("half track", self.half_track)

    @property
    def formation(self) -> FormationGeometry:
        """It sees the leader from the tractor's axle, relative to the tractor's heading."""
        return FormationGeometry("heading", self.hitch_length)

    @property
    def torques(self) -> TorqueMap:
        """Those of the tractor's wheels."""
        return TorqueMap("wheels", self.wheel_radius, self.half_track)


@dataclass(frozen=True)
class DifferentialDrive:
    """Robot with two driven wheels on one axle; its pose is (x, y, theta): the axle's midpoint [m], the heading [rad].

    The velocities are v of the axle's midpoint and omega = theta', the torques those of the right and the left wheel.

    Parameters
    ----------
    wheel_radius
        Radius r of the wheels [m].
    half_track
        Half the distance 2b between the wheels [m].

    Raises
    ------
    ControllerError
        If one of them is not a positive length.
    """

    wheel_radius: float
    half_track: float

    kind: ClassVar[str] = "differential_drive"
    pose: ClassVar[tuple[Entry, ...]] = (*X_Y, Entry("theta", "rad"))
    velocity: ClassVar[tuple[Entry, ...]] = V_OMEGA
    command: ClassVar[tuple[Entry, ...]] = WHEEL_TORQUES
    geometry: ClassVar[tuple[Entry, ...]] = (Entry("wheel_radius", "m"), Entry("half_track", "m"))
    pose_components: ClassVar[tuple[str, ...]] = names(pose)

    def __post_init__(self) -> None:
        _require_length("wheel radius", self.wheel_radius)
        _require_length("half track", self.half_track)

    @property
    def formation(self) -> FormationGeometry:
        """It sees the leader from its axle's midpoint, relative to its heading."""
        return FormationGeometry("none", self.half_track)

    @property
    def torques(self) -> TorqueMap:
        """Those of its wheels."""
        return TorqueMap("wheels", self.wheel_radius, self.half_track)


VEHICLES: Final[tuple[type[CarLike | TractorTrailer | DifferentialDrive], ...]] = (
    CarLike,
    TractorTrailer,
    DifferentialDrive,
)
"""The kinds of vehicles of this package."""


OTHERS: Final = "others that state their formation and torques"
"""Entry of a law's `vehicles` by which it serves kinds that it does not name, see `states_all`."""


def formation_of(vehicle: Vehicle) -> FormationGeometry | None:
    """Return how a vehicle sees its leader, or None if it does not state it."""
    formation = getattr(vehicle, "formation", None)
    return formation if isinstance(formation, FormationGeometry) else None


def torques_of(vehicle: Vehicle) -> TorqueMap | None:
    """Return the effect of a vehicle's torques, or None if it does not state it."""
    torques = getattr(vehicle, "torques", None)
    return torques if isinstance(torques, TorqueMap) else None


def states_all(vehicle: Vehicle) -> bool:
    """Tell whether a vehicle states all that a law of range and bearing needs which returns torques."""
    return formation_of(vehicle) is not None and torques_of(vehicle) is not None


def is_one_of(vehicles: Sequence[str], vehicle: Vehicle) -> bool:
    """Tell whether a vehicle is one of a law's `vehicles`: its kind is named, or `OTHERS` is and it states all."""
    return vehicle.kind in vehicles or (OTHERS in vehicles and states_all(vehicle))


def vehicle_fault(vehicle: object) -> str:
    """Return the fault in an object's statements as a vehicle, if there is one."""
    if isinstance(vehicle, type) or not isinstance(getattr(vehicle, "kind", None), str):
        known = ", ".join(kind.__name__ for kind in VEHICLES)
        return f"expected one that states kind, pose, velocity, command and geometry, such as {known}"
    for fact in ("pose", "velocity", "command", "geometry"):
        entries = getattr(vehicle, fact, None)
        if not (isinstance(entries, tuple) and all(isinstance(entry, Entry) for entry in entries)):
            return f"its {fact} is {entries!r}, expected a tuple of Entry(name, unit)"
        if not entries and fact != "geometry":
            return f"its {fact} has no entry"
        twice = sorted({name for name in names(entries) if names(entries).count(name) > 1})
        if twice:
            return f"its {fact} has two entries named {twice[0]!r}"
    units = [entry.unit for entry in vehicle.pose[:3]]  # type: ignore[attr-defined]
    if units != ["m", "m", "rad"]:
        return f"its pose begins with units {', '.join(units)}: expected x [m], y [m] and a heading [rad] first"
    missing = [name for name in names(vehicle.geometry) if not hasattr(vehicle, name)]  # type: ignore[attr-defined]
    if missing:
        return f"it states the geometry {missing[0]!r} but has no such attribute"
    if not isinstance(vehicle, Hashable):
        return "it cannot be hashed: a frozen dataclass can"
    return _formation_fault(vehicle)  # type: ignore[arg-type]


def _formation_fault(vehicle: Vehicle) -> str:
    """Return how a vehicle's `formation` contradicts its pose, velocities and commands, if it does."""
    for fact, expected in (("formation", FormationGeometry), ("torques", TorqueMap)):
        stated = getattr(vehicle, fact, None)
        if not (stated is None or isinstance(stated, expected)):
            return f"its {fact} is {stated!r}, expected a {expected.__name__}"
    formation, torques = formation_of(vehicle), torques_of(vehicle)
    if formation is not None:
        if [entry.unit for entry in vehicle.velocity] != ["m/s", "rad/s"]:
            return "it states a formation, which is for velocities v [m/s] and omega [rad/s]"
        if formation.steering != "none" and [entry.unit for entry in vehicle.pose[3:4]] != ["rad"]:
            return f"its formation steers by {formation.steering!r}, but its pose has no fourth entry [rad]"
    if torques is not None and [entry.unit for entry in vehicle.command] != ["N.m", "N.m"]:
        return "it states what torques do, but its commands are not two torques [N.m]"
    return ""


def is_positive(value: object) -> bool:
    """Tell whether a value is a positive and finite real number."""
    return is_finite(value) and float(value) > 0  # type: ignore[arg-type]


def is_finite(value: object) -> bool:
    """Tell whether a value is a real number, no truth value, that is finite as a double."""
    if not isinstance(value, numbers.Real) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def _require_length(name: str, value: float) -> None:
    if not is_positive(value):
        raise ControllerError(f"the {name} is {value} m: it must be a positive length")
