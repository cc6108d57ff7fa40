"""The promises of every controller, as one check that the tests of any package can call."""

from __future__ import annotations

import math
import pickle
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from formation_controllers.compiled import compiled_for
from formation_controllers.controller import Controller
from formation_controllers.errors import ControllerError
from formation_controllers.gains import Gains
from formation_controllers.interface import CompiledTick, Desired, Floats, Leader, Team, TickInputs
from formation_controllers.registry import interface_fault, statement_fault
from formation_controllers.vehicles import CarLike, DifferentialDrive, TractorTrailer, Vehicle, formation_of

VEHICLES: dict[str, Vehicle] = {
    "car_like": CarLike(wheelbase=1.2),
    "tractor_trailer": TractorTrailer(hitch_length=1.5, wheel_radius=0.15, half_track=0.4),
    "differential_drive": DifferentialDrive(wheel_radius=0.15, half_track=0.4),
}
"""The vehicles of section 5, and a robot like the tractor alone."""

Inputs = tuple[Floats, Leader, Desired, Floats]


class Output(NamedTuple):
    """The output of a team at a tick: commands (N, C) and telemetry, one record a follower."""

    commands: Floats
    telemetry: NDArray[np.void]


def check_controller(
    law: type[Controller[Any]],
    gains: Gains | Sequence[Gains] | None = None,
    size: int = 4,
    vehicle: Vehicle | None = None,
) -> None:
    """Check that a class follows the rules of `Controller`, on one vehicle or on each of `VEHICLES` that it serves.

    Its attributes are correct; its signals are finite at every step, in their shapes; a follower's commands and signals
    do not depend on its team; the same inputs give the same commands and signals to the last bit, in a copy, from a
    pickle and from the state as arrays or bytes; compiled start and tick give those of `start` and `step`; and inputs
    are left unchanged. The last follower is turned back: its heading starts beyond 180 degrees, and its bearing passes
    180 degrees. A law that refuses to start or to go on with it, by a `ControllerError`, is checked without it.

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
    fault = interface_fault(getattr(law, "interface", None)) or statement_fault(law)
    _require(not fault, f"{law.__name__} {fault}")
    served = [known for known in VEHICLES.values() if law.serves(known)] if vehicle is None else [vehicle]
    _require(bool(served), f"{law.__name__} serves none of {', '.join(VEHICLES)}: pass a vehicle that it serves")
    own = tuple(gains) if isinstance(gains, Sequence) else (law.gains_type() if gains is None else gains,) * size
    for chosen in served:
        _check_on(law, own, chosen, _course_for(law, own, chosen))


def _course_for(law: type[Controller[Any]], gains: tuple[Gains, ...], vehicle: Vehicle) -> list[Inputs]:
    """Return the course of the check, without the follower that is turned back if the law refuses it."""
    size = len(gains)
    course = _course(vehicle, size, 12)
    try:
        controller = law(Team(vehicle, size, 0.02), gains)
        controller.start(*_rows(course[0], range(size))[:3])
        for given in course:
            controller.step(*_rows(given, range(size)))
    except ControllerError:
        return _course(vehicle, size, 12, turned=False)
    except Exception:
        pass  # the check names it
    return course


def _check_on(law: type[Controller[Any]], gains: tuple[Gains, ...], vehicle: Vehicle, course: list[Inputs]) -> None:
    name, size = f"{law.__name__} on a {vehicle.kind}", len(gains)
    before = pickle.dumps(course)

    def started(rows: Sequence[int] = range(size)) -> Controller[Any]:
        controller = law(Team(vehicle, len(rows), 0.02), [gains[row] for row in rows])
        controller.start(*_rows(course[0], rows)[:3])
        return controller

    def run(controller: Controller[Any], rows: Sequence[int] = range(size)) -> list[Output]:
        return [_step(controller, _rows(given, rows)) for given in course]

    with _named(f"{name}: it fails at a start or a step"):  # on the inputs themselves, as in a run
        controller = law(Team(vehicle, size, 0.02), gains)
        controller.start(*course[0][:3])
        outputs = [_step(controller, given) for given in course]
    _require(pickle.dumps(course) == before, f"{name}: it changes its inputs")
    _check_telemetry(name, controller, outputs)

    with _named(f"{name}: a second run fails"):
        again = started()
        second = run(again)
    _require_same(second, outputs, f"{name}: a second run gives other {{}}")
    with _named(f"{name}: it fails after a reset"):
        again.reset()
        again.start(*_rows(course[0], range(size))[:3])
        third = run(again)
    _require_same(third, outputs, f"{name}: after a reset it gives other {{}}")
    _check_that_telemetry_is_output_alone(name, started(), course, outputs)

    shuffled = np.random.default_rng(2).permutation(size).tolist()
    lonely = f"{name}: a follower's {{}} depends on the rest of the team or on its place"
    for rows in (range(size)[::-1], shuffled, *([row] for row in range(size))):
        with _named(f"{name}: it fails in another team, of {len(rows)}"):
            part = run(started(rows), rows)
        wanted = [Output(commands[list(rows)], telemetry[list(rows)]) for commands, telemetry in outputs]
        _require_same(part, wanted, lonely, "torque")

    _check_compiled(name, started(), course, outputs, controller.to_bytes())
    _require(pickle.dumps(course) == before, f"{name}: its compiled start or tick changes its inputs")

    twins: dict[str, Controller[Any]] = {}
    with _named(f"{name}: it cannot be copied"):
        twins["a copy"] = controller.copy()
    with _named(f"{name}: it cannot be pickled"):
        twins["a pickle"] = pickle.loads(pickle.dumps(controller))
    for how in ("state", "bytes"):
        twins[f"a controller set from {how}"] = twin = law(controller.team, gains)
        with _named(f"{name}: it cannot be set from its {how}"):
            if how == "state":
                twin.set_state(controller.get_state())
            else:
                twin.from_bytes(controller.to_bytes())
    back = [_rows(given, range(size)) for given in reversed(course)]  # from where the course has ended
    with _named(f"{name}: it fails at further steps"):
        wanted = [_step(controller, given) for given in back]
    for which, twin in twins.items():
        with _named(f"{name}: {which} fails at its steps, so that something is not in its state"):
            own = [_step(twin, given) for given in back]
        _require_same(own, wanted, f"{name}: {which} gives other {{}}")

    state, (pose, leader, desired, velocity) = controller.to_bytes(), course[0]
    lost = pose.copy()
    lost[0, 1] = math.nan
    try:
        controller.step(lost, leader, desired, velocity)
    except ControllerError:
        _require(controller.to_bytes() == state, f"{name}: a refused step changes its state")
    except Exception as error:
        raise AssertionError(
            f"{name}: a pose that is not a number ends in {type(error).__name__}, expected a ControllerError: {error}"
        ) from error
    else:
        raise AssertionError(f"{name}: it accepts a pose that is not a number")


def _require(holds: bool, rule: str) -> None:
    """Raise an AssertionError that names the rule unless it holds, also under ``python -O``."""
    if not holds:
        raise AssertionError(rule)


def _require_same(outputs: list[Output], wanted: list[Output], rule: str, commands: str = "torques") -> None:
    """Require equal bits; the rule has a place for what differs."""
    for output, expected in zip(outputs, wanted, strict=True):
        _require(_bits(output.commands) == _bits(expected.commands), rule.format(commands))
        for signal in expected.telemetry.dtype.names or ():
            same = _bits(output.telemetry[signal]) == _bits(expected.telemetry[signal])
            _require(same, rule.format(f"signal {signal}"))


def _bits(array: NDArray[Any]) -> bytes:
    return array.astype(float).tobytes()


@contextmanager
def _named(rule: str) -> Iterator[None]:
    """Raise any exception of a law as an AssertionError that names the rule."""
    try:
        yield
    except Exception as error:
        raise AssertionError(f"{rule}: {type(error).__name__}: {error}") from error


def _step(controller: Controller[Any], given: Inputs) -> Output:
    """Take a step; a law may use the memory of its output again."""
    commands = controller.step(*given)
    return Output(commands.copy(), controller.telemetry_record.copy())


def _check_telemetry(name: str, controller: Controller[Any], outputs: list[Output]) -> None:
    told, size = controller.telemetry(), controller.team.size
    for signal in controller.signals:
        shape = (size, len(signal.components)) if signal.components else (size,)
        _require(told[signal.name].shape == shape, f"{name}: signal {signal.name} has shape {told[signal.name].shape}")
    _require_finite(name, controller, outputs)


def _require_finite(name: str, controller: Controller[Any], outputs: list[Output]) -> None:
    for signal in controller.signals:
        for k, output in enumerate(outputs, start=1):
            values = output.telemetry[signal.name]
            wrong = values[~np.isfinite(values)]
            rule = f"{name}: signal {signal.name} is not finite at every step"
            told = "nan, also if it is not written" if np.isnan(wrong).any() else "infinite"
            _require(not wrong.size, f"{rule}: at step {k} it is {told}")


def _check_that_telemetry_is_output_alone(
    name: str, controller: Controller[Any], course: list[Inputs], wanted: list[Output]
) -> None:
    """Require the same outputs of a controller whose telemetry is taken away before each step."""
    outputs = []
    with _named(f"{name}: it fails without the signals of the step before, which are no state"):
        for given in course:
            _forget(controller)
            outputs.append(_step(controller, _rows(given, range(controller.team.size))))
    _require_finite(name, controller, outputs)
    rule = f"{name}: without the signals of the step before, which are no state, it gives other {{}}"
    _require_same(outputs, wanted, rule)


def _forget(controller: Controller[Any]) -> None:
    record = controller.telemetry_record
    record[...] = np.full((), math.nan, record.dtype)


def _check_compiled(
    name: str, controller: Controller[Any], course: list[Inputs], wanted: list[Output], last: bytes
) -> None:
    """Require of compiled start and tick, where a law has them, what `start` and `step` give."""
    with _named(f"{name}: its compiled_tick or compiled_start fails"):
        tick, start = controller.compiled_tick(), controller.compiled_start()
    state, inputs = controller.to_bytes(), [_tick_inputs(controller, given) for given in course]
    if start is not None:
        controller.set_state(
            {
                field: value if field in start.prepared else np.zeros_like(value)
                for field, value in controller.get_state().items()
            }
        )
        with _named(f"{name}: its compiled_start fails"):
            compiled_for(start.function, inputs[0], start.own)(inputs[0], start.own)
        _require(controller.to_bytes() == state, f"{name}: its compiled_start sets another state than start")
    if tick is None:
        return
    outputs = []
    with _named(f"{name}: its compiled_tick fails"):
        for given in inputs:
            _forget(controller)
            outputs.append(_compiled_step(controller, tick, given))
    _require_same(outputs, wanted, f"{name}: its compiled_tick gives other {{}} than step")
    _require(controller.to_bytes() == last, f"{name}: its compiled_tick advances its state otherwise than step")


def _compiled_step(controller: Controller[Any], tick: CompiledTick, inputs: TickInputs) -> Output:
    commands = np.full((controller.team.size, len(controller.team.vehicle.command)), math.nan)
    compiled_for(tick.function, inputs, tick.own, commands)(inputs, tick.own, commands)
    return Output(commands, controller.telemetry_record.copy())


def _tick_inputs(controller: Controller[Any], given: Inputs) -> TickInputs:
    """Return the inputs of a tick as compiled code gets them: velocities only where the law needs them."""
    pose, leader, desired, velocity = given
    measured = velocity if "velocity" in controller.needs else np.full(velocity.shape, math.nan)
    acceleration = np.zeros(len(leader.velocity)) if leader.acceleration is None else leader.acceleration
    return TickInputs(pose, measured, leader.pose, leader.velocity, acceleration, *desired)


def _course(vehicle: Vehicle, size: int, ticks: int, turned: bool = True) -> list[Inputs]:
    """Return followers that wander behind a leader, with a desired range and bearing that change: one entry a tick.

    The last one may be turned back, by a turn and a half: there its heading and its bearing pass 180 degrees. The
    desired bearing is within half a turn.
    """
    random = np.random.default_rng(1)
    others, velocities = len(vehicle.pose) - 3, len(vehicle.velocity)
    low, high = [-6, -3, -0.4, *[-0.3] * others], [-4, 3, 0.4, *[0.3] * others]
    pose = random.uniform(low, high, (size, len(low)))
    formation = formation_of(vehicle)
    headings = [2, 3] if formation is not None and formation.steering == "heading" else [2]
    turning = np.zeros(len(low))
    if turned:
        turning[1], turning[headings] = 0.02, 0.02
        pose[-1, :3], pose[-1, 3:] = (-5.0, -0.1, 0.0), 0.1 * pose[-1, 3:]
        pose[-1, headings] += 3 * math.pi - 0.1
    seen = np.arctan2(-pose[:, 1], -pose[:, 0]) - pose[:, 2]
    seen -= 2 * math.pi * np.round(seen / (2 * math.pi))
    q = np.column_stack([np.hypot(pose[:, 0], pose[:, 1]), seen])
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
        pose[-1] += turning
    return course


def _rows(given: Inputs, rows: Sequence[int]) -> Inputs:
    """Return copies of the inputs of some followers."""
    pose, leader, desired, velocity = given
    chosen = list(rows)
    return pose[chosen], leader, Desired(*(array[chosen] for array in desired)), velocity[chosen]
