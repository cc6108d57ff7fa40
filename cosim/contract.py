"""Vehicle contracts: which roles a plant must offer, in which unit, so that a controller can drive it.

The master knows a plant by these roles alone; `cosim.binding` finds the variables of an FMU that play them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Role:
    """What a variable is for: its name in the contract, which causality it must have, and the unit used.

    A role without a unit is played by an enumeration, all others by a real variable. A plant may lack an optional role.
    """

    name: str
    causality: str
    unit: str
    optional: bool = False


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


_VELOCITY = (Role("v", "output", "m/s", optional=True), Role("omega", "output", "rad/s", optional=True))


def _disturbances(*angles: str) -> tuple[Role, ...]:
    """Return the disturbances tau_d1 of (1), which oppose motion where they are positive."""
    units = {"x": "N", "y": "N"} | dict.fromkeys(angles, "N.m")
    return tuple(Role(f"tau_d_{name}", "input", unit, optional=True) for name, unit in units.items())


CAR_LIKE = Contract(
    vehicle="car_like",
    pose=(
        Role("x", "output", "m"),
        Role("y", "output", "m"),
        Role("psi", "output", "rad"),
        Role("gamma", "output", "rad"),
    ),
    velocity=_VELOCITY,
    torque=(Role("tau_drive", "input", "N.m"), Role("tau_steer", "input", "N.m")),
    disturbance=_disturbances("psi", "gamma"),
    geometry={"wheelbase": Role("a", "parameter", "m"), "drive": Role("drive", "parameter", "")},
)

TRACTOR_TRAILER = Contract(
    vehicle="tractor_trailer",
    pose=(
        Role("x", "output", "m"),
        Role("y", "output", "m"),
        Role("theta_1", "output", "rad"),
        Role("theta_0", "output", "rad"),
    ),
    velocity=_VELOCITY,
    torque=(Role("tau_right", "input", "N.m"), Role("tau_left", "input", "N.m")),
    disturbance=_disturbances("theta_1", "theta_0"),
    geometry={
        "hitch_length": Role("d", "parameter", "m"),
        "wheel_radius": Role("r", "parameter", "m"),
        "half_track": Role("b", "parameter", "m"),
    },
)

CONTRACTS = (CAR_LIKE, TRACTOR_TRAILER)


def labels(contracts: Iterable[Contract], roles: str) -> tuple[str, ...]:
    """Return names for the entries of the roles ``pose``, ``velocity`` or ``torque`` that fit all of the contracts.

    Where vehicles differ the names are joined, as in "psi/theta_1".
    """
    names = zip(*([role.name for role in getattr(contract, roles)] for contract in contracts), strict=True)
    return tuple("/".join(dict.fromkeys(entry)) for entry in names)
