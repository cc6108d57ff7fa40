"""The promises of every controller, as one check that the tests of any package can call."""

from __future__ import annotations

import math
import pickle
from collections.abc import Sequence
from typing import Any

import numpy as np

from formation_controllers.controller import Controller
from formation_controllers.errors import ControllerError
from formation_controllers.gains import Gains
from formation_controllers.interface import Desired, Floats, Leader, Team
from formation_controllers.registry import statement_fault
from formation_controllers.vehicles import CarLike, DifferentialDrive, TractorTrailer, Vehicle

VEHICLES: dict[str, Vehicle] = {
    "car_like": CarLike(wheelbase=1.2),
    "tractor_trailer": TractorTrailer(hitch_length=1.5, wheel_radius=0.15, half_track=0.4),
    "differential_drive": DifferentialDrive(wheel_radius=0.15, half_track=0.4),
}
"""The vehicles of section 5, and a robot like the tractor alone."""

Inputs = tuple[Floats, Leader, Desired, Floats]


def check_controller(
    law: type[Controller[Any]],
    gains: Gains | Sequence[Gains] | None = None,
    size: int = 4,
    vehicle: Vehicle | None = None,
) -> None:
    """Check that a class follows the rules of `Controller`, on one vehicle or on each of `VEHICLES` that it serves.

    Its attributes are correct; a follower's commands do not depend on its team; the same inputs give
    the same commands to the last bit, in a copy, from a pickle and from the state as arrays or bytes; inputs are
    left unchanged; and telemetry has the shapes of the signals.

    Parameters
    ----------
    law
        The class.
    gains
        Its gains: one object or one for each follower; the defaults if left out.
    size
        Number of followers, unless there is an object of gains for each.
    vehicle
        The vehicle for the check; default: every one of `VEHICLES` that the law serves.

    Raises
    ------
    AssertionError
        A rule is broken; the message names it.
    """
    fault = statement_fault(law)
    assert not fault, f"{law.__name__} {fault}"
    served = [known for known in VEHICLES.values() if law.serves(known)] if vehicle is None else [vehicle]
    assert served, f"{law.__name__} serves none of {', '.join(VEHICLES)}: pass a vehicle that it serves"
    own = tuple(gains) if isinstance(gains, Sequence) else (law.gains_type() if gains is None else gains,) * size
    for chosen in served:
        _check_on(law, own, chosen, _course(chosen, len(own), 12))


def _check_on(law: type[Controller[Any]], gains: tuple[Gains, ...], vehicle: Vehicle, course: list[Inputs]) -> None:
    name, size = f"{law.__name__} on a {vehicle.kind}", len(gains)

    def run(rows: Sequence[int]) -> tuple[Controller[Any], list[Floats]]:
        controller = law(Team(vehicle, len(rows), 0.02), [gains[row] for row in rows])
        inputs = course if rows == range(size) else [_rows(given, rows) for given in course]
        controller.start(*inputs[0][:3])
        return controller, [controller.step(*given) for given in inputs]

    before = pickle.dumps(course)
    controller, torques = run(range(size))
    assert pickle.dumps(course) == before, f"{name}: it changes its inputs"
    _check_telemetry(name, controller, size)

    again, repeated = run(range(size))
    assert _same(torques, repeated), f"{name}: a second run gives other torques"
    again.reset()
    again.start(*course[0][:3])
    assert _same([again.step(*given) for given in course], torques), f"{name}: after a reset it gives other torques"

    shuffled = np.random.default_rng(2).permutation(size).tolist()
    for rows in (range(size)[::-1], shuffled, *([row] for row in range(size))):
        _, part = run(rows)
        wanted = [torque[list(rows)] for torque in torques]
        assert _same(part, wanted), f"{name}: a follower's torque depends on the rest of the team or on its place"

    twins = {"a copy": controller.copy(), "a pickle": pickle.loads(pickle.dumps(controller))}
    for how in ("state", "bytes"):
        twins[f"a controller set from {how}"] = twin = law(controller.team, gains)
        if how == "state":
            twin.set_state(controller.get_state())
        else:
            twin.from_bytes(controller.to_bytes())
    wanted = [controller.step(*given) for given in course]
    for which, twin in twins.items():
        assert _same([twin.step(*given) for given in course], wanted), f"{name}: {which} gives other torques"

    state, (pose, leader, desired, velocity) = controller.to_bytes(), course[0]
    lost = pose.copy()
    lost[0, 1] = math.nan
    try:
        controller.step(lost, leader, desired, velocity)
    except ControllerError:
        assert controller.to_bytes() == state, f"{name}: a refused step changes its state"
    else:
        raise AssertionError(f"{name}: it accepts a pose that is not a number")


def _check_telemetry(name: str, controller: Controller[Any], size: int) -> None:
    told = controller.telemetry()
    for signal in controller.signals:
        shape = (size, len(signal.components)) if signal.components else (size,)
        assert told[signal.name].shape == shape, f"{name}: signal {signal.name} has shape {told[signal.name].shape}"
        assert np.isfinite(told[signal.name]).all(), f"{name}: signal {signal.name} is not written at every step"


def _course(vehicle: Vehicle, size: int, ticks: int) -> list[Inputs]:
    """Return followers that wander behind a leader, with a desired range and bearing that change: one entry a tick."""
    random = np.random.default_rng(1)
    others, velocities = len(vehicle.pose) - 3, len(vehicle.velocity)
    low, high = [-6, -3, -0.4, *[-0.3] * others], [-4, 3, 0.4, *[0.3] * others]
    pose = random.uniform(low, high, (size, len(low)))
    q = np.column_stack([np.hypot(pose[:, 0], pose[:, 1]), np.arctan2(-pose[:, 1], -pose[:, 0]) - pose[:, 2]])
    course = []
    for k in range(ticks):
        leader = Leader(
            np.array([0.006 * k, 0.001 * k, 0.02, *[0.01] * others]),
            np.resize([0.3, 0.01], velocities),
            np.resize([0.02, 0.0], velocities),
        )
        rate = random.normal(0, 0.01, (2, size, 2))
        velocity = random.normal(0, 0.1, (size, velocities))
        course.append((pose + random.normal(0, 0.01, pose.shape), leader, Desired(q + 0.1, *rate), velocity))
    return course


def _rows(given: Inputs, rows: Sequence[int]) -> Inputs:
    pose, leader, desired, velocity = given
    chosen = list(rows)
    return pose[chosen], leader, Desired(*(array[chosen] for array in desired)), velocity[chosen]


def _same(one: list[Floats], other: list[Floats]) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
