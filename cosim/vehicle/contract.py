"""Vehicle contracts: which roles a plant must offer, in which unit, so that a controller can drive it.

The master knows a plant by these roles alone; `cosim.fmu.binding` finds the variables of an FMU that play them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from formation_controllers.vehicles import DRIVES


@dataclass(frozen=True)
class Role:
    """What a variable is for: its name in the contract, which causality it must have, and the unit used.

    A role without a unit is played by an enumeration, all others by a real variable. A plant may lack an optional role.
    Its meaning says where zero is and which way is positive. `items` are those of the enumeration.
    """

    name: str
    causality: str
    unit: str
    optional: bool = False
    meaning: str = ""
    items: tuple[str, ...] = ()


@dataclass(frozen=True)
class Contract:
    """The roles of one kind of vehicle.

    Attributes
    ----------
    vehicle : str
        The kind, as the controllers name it.
    pose, velocity, torque : tuple of Role
        Four pose entries and two pseudo-velocities out, two torques in.
    disturbance : tuple of Role
        Other inputs, by which a scenario can disturb the vehicle.
    geometry : dict
        Fields of the controllers' vehicle description, each with the parameter that holds it.
    """

    vehicle: str
    pose: tuple[Role, ...]
    velocity: tuple[Role, ...]
    torque: tuple[Role, ...]
    disturbance: tuple[Role, ...]
    geometry: dict[str, Role]

    @property
    def roles(self) -> Iterable[Role]:
        """All roles."""
        return (*self.pose, *self.velocity, *self.torque, *self.disturbance, *self.geometry.values())


def _disturbances(*angles: str) -> tuple[Role, ...]:
    """Return the disturbances tau_d1 of (1), which oppose motion where they are positive."""
    units = {"x": "N", "y": "N"} | dict.fromkeys(angles, "N.m")
    return tuple(
        Role(f"tau_d_{name}", "input", unit, optional=True, meaning=f"disturbance along {name}, opposing motion")
        for name, unit in units.items()
    )


CAR_LIKE = Contract(
    vehicle="car_like",
    pose=(
        Role("x", "output", "m", meaning="the rear axle's midpoint along X"),
        Role("y", "output", "m", meaning="the rear axle's midpoint along Y, to the left of X"),
        Role("psi", "output", "rad", meaning="the heading, counter-clockwise from X"),
        Role("gamma", "output", "rad", meaning="the steering angle, counter-clockwise from the body"),
    ),
    velocity=(
        Role("v", "output", "m/s", optional=True, meaning="the forward velocity of the rear axle's midpoint"),
        Role("omega", "output", "rad/s", optional=True, meaning="the steering rate, counter-clockwise"),
    ),
    torque=(
        Role("tau_drive", "input", "N.m", meaning="the drive torque, forward"),
        Role("tau_steer", "input", "N.m", meaning="the steering torque, counter-clockwise"),
    ),
    disturbance=_disturbances("psi", "gamma"),
    geometry={
        "wheelbase": Role("a", "parameter", "m", meaning="the wheelbase"),
        "drive": Role(
            "drive",
            "parameter",
            "",
            meaning="how the drive torque acts: as_printed, front_wheel or rear_wheel",
            items=DRIVES,
        ),
    },
)

TRACTOR_TRAILER = Contract(
    vehicle="tractor_trailer",
    pose=(
        Role("x", "output", "m", meaning="the trailer's axle midpoint along X"),
        Role("y", "output", "m", meaning="the trailer's axle midpoint along Y, to the left of X"),
        Role("theta_1", "output", "rad", meaning="the trailer's heading, counter-clockwise from X"),
        Role("theta_0", "output", "rad", meaning="the tractor's heading, counter-clockwise from X"),
    ),
    velocity=(
        Role("v", "output", "m/s", optional=True, meaning="the forward velocity of the trailer's axle midpoint"),
        Role(
            "omega", "output", "rad/s", optional=True, meaning="the angular velocity of the tractor, counter-clockwise"
        ),
    ),
    torque=(
        Role("tau_right", "input", "N.m", meaning="the torque of the tractor's right wheel, forward"),
        Role("tau_left", "input", "N.m", meaning="the torque of the tractor's left wheel, forward"),
    ),
    disturbance=_disturbances("theta_1", "theta_0"),
    geometry={
        "hitch_length": Role("d", "parameter", "m", meaning="the distance from the trailer's axle to the hitch"),
        "wheel_radius": Role("r", "parameter", "m", meaning="the radius of the tractor's wheels"),
        "half_track": Role("b", "parameter", "m", meaning="half the distance between the tractor's wheels"),
    },
)

CONTRACTS = (CAR_LIKE, TRACTOR_TRAILER)


def labels(contracts: Iterable[Contract], roles: str) -> tuple[str, ...]:
    """Return names for the entries of the roles ``pose``, ``velocity`` or ``torque`` that fit all of the contracts.

    Where vehicles differ the names are joined, as in "psi/theta_1".
    """
    names = zip(*([role.name for role in getattr(contract, roles)] for contract in contracts), strict=True)
    return tuple("/".join(dict.fromkeys(entry)) for entry in names)
