"""A scenario with everything that it names: found, checked and fitting together, and nothing started yet."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

import formation_controllers as fc
from formation_controllers.vehicles import Vehicle, is_one_of

from cosim.control.hosts import Hosts
from cosim.control.law import Law, LawGains, find_law, gains_of
from cosim.control.leader_view import LeaderView
from cosim.errors import InputError
from cosim.fmu.vehicle import Fmu
from cosim.known import Known
from cosim.master.common_effects import check_common_effects
from cosim.master.content import parts_told
from cosim.master.foreign import for_whole_run
from cosim.master.result_variables import recorded_signals, result_variables_of
from cosim.master.robot import RobotSetup
from cosim.master.robots import followers_of, leader_of
from cosim.master.timing import timed
from cosim.master.used_fmus import open_fmus
from cosim.master.velocities import check_velocities
from cosim.results.expectations import Recorded, Recording, check
from cosim.results.expectations.recorded import DERIVED
from cosim.results.result_variable import ResultVariable
from cosim.scenario.reader import read_scenario
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import Scenario
from cosim.signals.desired_places import desired_places
from cosim.signals.trajectory import leader_motion
from cosim.storage import Storage
from cosim.vehicle.columns import RunColumns, run_columns
from cosim.vehicle.path import Motion

MAX_BYTES = 64 * 1024**3
"""Upper limit for the numbers of a result. A large run needs twice as much room on the disk, and little memory."""


@dataclass(frozen=True)
class Other:
    """A scenario that another one is compared with, ready to run.

    Attributes
    ----------
    scenario : Scenario
        The scenario, without expectations.
    setup : Setup
        Its set-up.
    content : tuple of str
        Versions and checksums, at the set-up, of the controllers, FMUs and files that it names.
    """

    scenario: Scenario
    setup: Setup
    content: tuple[str, ...]


@dataclass(frozen=True)
class Setup:
    """Everything that a run of a scenario needs.

    Attributes
    ----------
    leader, followers
        The robots.
    motion : Motion or None
        Motion of a leader with a <trajectory>.
    desired : formation_controllers.Desired
        Place of every follower at every tick and two derivatives, each (ticks + 1, N, 2).
    opened : dict
        The FMU of each plant of the scenario, by its id.
    fmus : dict
        Those of plants that are used.
    laws : dict
        The control law of each controller that is used, by its id.
    gains : tuple
        The gains of each follower.
    result_variables : tuple of ResultVariable
        The variables that are recorded.
    signals : dict
        The signals that expectations can name: recorded variables, and those computed from them.
    others : dict
        Scenarios that this one is compared with, by file.
    storage : Storage
        Where signals over time lie, and records may.
    hosts : Hosts
        Hosts of controllers in environments of their own.
    """

    leader: RobotSetup
    followers: tuple[RobotSetup, ...]
    motion: Motion | None
    desired: fc.Desired
    opened: Mapping[str, Fmu]
    fmus: Mapping[str, Fmu]
    laws: Mapping[str, Law]
    gains: tuple[LawGains, ...]
    result_variables: tuple[ResultVariable, ...]
    signals: Mapping[str, Recorded]
    others: Mapping[Path, Other]
    storage: Storage
    hosts: Hosts = field(default_factory=Hosts)

    @property
    def columns(self) -> RunColumns:
        """The columns of poses, velocities and commands in a result."""
        return run_columns([robot.kind for robot in (self.leader, *self.followers)])


def set_up(
    scenario: Scenario,
    cleanup: ExitStack,
    timing: dict[str, float],
    before: Setup | None = None,
    known: Known | None = None,
    storage: Storage | None = None,
) -> Setup:
    """Find and check everything that a scenario names. Built-in plants are built if they are not in the cache.

    Parameters
    ----------
    scenario
        The scenario.
    cleanup
        Receives the clean-up callbacks.
    timing
        Gets the seconds that were spent, by part.
    before
        The set-up of another run with the same plants: FMUs and scenarios to compare with are taken from it.
    known
        What is known from other runs, also of laws.
    storage
        Where signals over time shall lie; without one, in memory or in the folder of temporary files.

    Raises
    ------
    InputError
        A part does not exist or does not fit; the message has its place in the scenario.
    """
    storage, known = storage or Storage(), known or Known()
    if before is None:
        hosts = Hosts()
        cleanup.callback(hosts.stop)
    else:
        hosts = before.hosts
    hosts.launch(scenario.controllers.values())
    fmus = open_fmus(scenario, cleanup, timing, {} if before is None else before.opened, known)
    with timed(timing, "controllers"):
        found = {name: known.of(name, find_law, source, hosts) for name, source in scenario.controllers.items()}
        controlling = {follower.controller for follower in scenario.followers}
        laws = {name: law for name, law in found.items() if name in controlling}
    columns = run_columns([fmus[name].binding.kind for name in _plants_of(scenario)])
    controlled = tuple((follower.id, laws[follower.controller]) for follower in scenario.followers)
    measured = bool(scenario.leader.sensor)
    variables = known.of("", result_variables_of, columns, controlled, measured, tuple(laws.values()))
    _check_size(scenario, size_of_result(scenario, variables))  # before any array of that size is made
    with timed(timing, "signals"):
        leader = leader_of(scenario, fmus, storage, None if before is None else before.leader, known)
        motion = None
        if scenario.leader.trajectory is not None:
            motion = leader_motion(scenario.leader.trajectory, leader.kind, leader.vehicle, scenario.clock, storage)
        followers = followers_of(scenario, fmus, storage, () if before is None else before.followers, known)
        kinds = tuple(dict.fromkeys(robot.kind for robot in followers))
        times = Times(scenario.step, scenario.ticks)
        known.of("", check_common_effects, scenario.sensor, scenario.actuator, kinds, times)
        desired = fc.Desired(*desired_places(scenario.followers, scenario.clock, storage))
    with timed(timing, "controllers"):
        gains = tuple(gains_of(laws[follower.controller], follower.gains) for follower in scenario.followers)
    _check_views(leader, followers)
    _check_kinds(scenario, followers, laws)
    check_velocities(scenario, leader, followers, laws)
    used = set(_plants_of(scenario))
    signals = known.of("", recorded_signals, variables, columns, controlled)
    others: dict[Path, Other] = {} if before is None else dict(before.others)

    def prepare(path: Path) -> Recording:
        """Read and set up a scenario to compare with, once; its own expectations are not read."""
        if path not in others:
            other = for_whole_run(replace(read_scenario(path, untrusted=scenario.untrusted), expectations=()))
            its = set_up(other, cleanup, {}, storage=storage)
            others[path] = Other(other, its, tuple(parts_told(other, its.laws, its.opened)))
        return Recording(others[path].scenario, others[path].setup.signals)

    shapeless = {robot.name: robot.kind.name for robot in followers if robot.outline is None}
    check(scenario, signals, prepare, shapeless)
    return Setup(
        leader=leader,
        followers=followers,
        motion=motion,
        desired=desired,
        opened=fmus,
        fmus={name: fmu for name, fmu in fmus.items() if name in used},
        laws=laws,
        gains=gains,
        result_variables=variables,
        signals=signals,
        others=others,
        storage=storage,
        hosts=hosts,
    )


def size_of_result(scenario: Scenario, variables: Iterable[ResultVariable]) -> int:
    """Return how many bytes of numbers the result of a whole run has."""
    computed = len(DERIVED) * len(scenario.followers)
    return (scenario.ticks + 1) * (8 * (1 + computed) + sum(variable.bytes_per_sample for variable in variables))


def _check_size(scenario: Scenario, size: int) -> None:
    if size <= MAX_BYTES:
        return
    each = size / (scenario.ticks + 1)
    most = int(MAX_BYTES / each) - 1
    remedies = "give it fewer robots"
    if most > 0:
        horizon, step = _rounded(most * scenario.step, -1), _rounded(scenario.horizon / most, 1)
        remedies = f"shorten the horizon to {horizon:.12g} s, lengthen the step to {step:.12g} s, or {remedies}"
    raise InputError(
        f"the scenario {scenario.name!r} would record {size / 1024**3:.1f} GiB, {scenario.ticks + 1} samples of "
        f"{each / 1024:.2g} KiB; {MAX_BYTES / 1024**3:g} GiB are allowed: {remedies}",
        scenario.where,
    )


def _rounded(number: float, up: int) -> float:
    """Return a number rounded to two digits, up or down."""
    digit = 10.0 ** (int(f"{number:e}".partition("e")[2]) - 1)
    return digit * (math.ceil(number / digit) if up > 0 else math.floor(number / digit))


def _plants_of(scenario: Scenario) -> list[str]:
    return [scenario.leader.plant, *(follower.plant for follower in scenario.followers)]


def _check_kinds(scenario: Scenario, followers: Iterable[RobotSetup], laws: Mapping[str, Law]) -> None:
    """Refuse followers whose law does not serve their kind of vehicle."""
    for follower, robot in zip(scenario.followers, followers, strict=True):
        law = laws[follower.controller]
        if not is_one_of(law.vehicles, robot.vehicle) and not _serves(law, robot.vehicle):
            raise InputError(
                f"{robot.name}: the controller {law.source.name!r} serves vehicles of kind {', '.join(law.vehicles)}, "
                f"not {robot.vehicle.kind}",
                follower.where,
            )


def _serves(law: Law, vehicle: Vehicle) -> bool:
    """Return whether a law says itself that it serves a vehicle; one that fails at that is told where it is made."""
    if law.controller_type is None:
        return False
    try:
        return bool(law.controller_type.serves(vehicle))
    except Exception:
        return True


def _check_views(leader: RobotSetup, followers: Iterable[RobotSetup]) -> None:
    """Refuse followers that cannot follow a leader of this kind."""
    for robot in followers:
        try:
            LeaderView(robot.kind, robot.vehicle, leader.kind, leader.vehicle).check()
        except InputError as error:
            raise InputError(f"{robot.name}: {error.message}", robot.where) from None
