"""A scenario with everything that it names: found, checked and fitting together, and nothing started yet."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import formation_controllers as fc
import numpy as np

from cosim.clock import Clock
from cosim.control.leader_view import check_view
from cosim.control.team import Law, find_law, gains_of
from cosim.errors import InputError
from cosim.fmu.package import Fmu
from cosim.known import Known
from cosim.master.common_effects import check_common_effects
from cosim.master.result_variables import recorded_signals, result_variables_of
from cosim.master.robot import RobotSetup
from cosim.master.robots import followers_of, leader_of
from cosim.master.timing import timed
from cosim.master.used_fmus import open_fmus
from cosim.master.velocities import check_velocities
from cosim.results.expectations import Recorded, Recording, check
from cosim.results.result_variable import ResultVariable
from cosim.scenario.reader import read_scenario
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import PlaceChange, Scenario
from cosim.signals.desired_places import desired_samples
from cosim.signals.trajectory import leader_motion
from cosim.vehicle.columns import RunColumns, run_columns
from cosim.vehicle.path import Motion

MAX_BYTES = 4 * 1024**3
"""Upper limit for the records of a run, and for the signals that drive it."""


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
        Scenarios that this one is compared with, each with its own set-up, by file.
    """

    leader: RobotSetup
    followers: tuple[RobotSetup, ...]
    motion: Motion | None
    desired: fc.Desired
    opened: Mapping[str, Fmu]
    fmus: Mapping[str, Fmu]
    laws: Mapping[str, Law]
    gains: tuple[fc.Gains, ...]
    result_variables: tuple[ResultVariable, ...]
    signals: Mapping[str, Recorded]
    others: Mapping[Path, tuple[Scenario, Setup]]

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

    Raises
    ------
    InputError
        A part does not exist or does not fit; the message has its place in the scenario.
    """
    known = known or Known()
    fmus = open_fmus(scenario, cleanup, timing, {} if before is None else before.opened, known)
    _check_size(scenario, _least_bytes(scenario, fmus))  # before any array of that size is made
    with timed(timing, "signals"):
        leader = leader_of(scenario, fmus, None if before is None else before.leader, known)
        motion = None
        if scenario.leader.trajectory is not None:
            motion = leader_motion(scenario.leader.trajectory, leader.vehicle, scenario.clock.times)
        followers = followers_of(scenario, fmus, () if before is None else before.followers, known)
        kinds = tuple(dict.fromkeys(robot.kind for robot in followers))
        times = Times(scenario.step, scenario.ticks)
        known.of("", check_common_effects, scenario.sensor, scenario.actuator, kinds, times)
        places = tuple((follower.desired, follower.changes) for follower in scenario.followers)
        desired = known.of("", _desired, places, scenario.clock)
    with timed(timing, "controllers"):
        found = {name: known.of(name, find_law, source) for name, source in scenario.controllers.items()}
        controlling = {follower.controller for follower in scenario.followers}
        laws = {name: law for name, law in found.items() if name in controlling}
        gains = tuple(gains_of(laws[follower.controller], follower.gains) for follower in scenario.followers)
    _check_views(leader, followers)
    check_velocities(scenario, leader, followers, laws)
    columns = run_columns([robot.kind for robot in (leader, *followers)])
    used = set(_plants_of(scenario))
    measured = bool(scenario.leader.sensor)
    variables = known.of("", result_variables_of, columns, len(followers), measured, tuple(laws.values()))
    _check_size(scenario, sum(variable.bytes_per_sample for variable in variables))
    controlled = tuple((follower.id, laws[follower.controller]) for follower in scenario.followers)
    signals = known.of("", recorded_signals, variables, columns, controlled)
    others: dict[Path, tuple[Scenario, Setup]] = {} if before is None else dict(before.others)

    def prepare(path: Path) -> Recording:
        """Read and set up a scenario to compare with, once; its own expectations are not read."""
        if path not in others:
            other = replace(read_scenario(path, untrusted=scenario.untrusted), expectations=())
            others[path] = other, set_up(other, cleanup, {})
        other, setup = others[path]
        return Recording(other, setup.signals)

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
    )


def _desired(places: Sequence[tuple[tuple[float, float], tuple[PlaceChange, ...]]], clock: Clock) -> fc.Desired:
    """Return the places of all followers over time."""
    samples = [desired_samples(desired, changes, clock.times) for desired, changes in places]
    return fc.Desired(*(np.stack(parts, axis=1) for parts in zip(*samples, strict=True)))


def _check_size(scenario: Scenario, bytes_per_tick: int) -> None:
    size = (scenario.ticks + 1) * bytes_per_tick
    if size > MAX_BYTES:
        raise InputError(
            f"the scenario {scenario.name!r} would record {size / 1024**3:.1f} GiB, more than "
            f"{MAX_BYTES // 1024**3} GiB: shorten its horizon or lengthen its step"
        )


def _least_bytes(scenario: Scenario, fmus: Mapping[str, Fmu]) -> int:
    """Return what is recorded at a tick for any laws: states and commands, of followers also measured poses."""
    leader, *followers = [fmus[name].binding.kind for name in _plants_of(scenario)]
    numbers = sum(len(kind.states) + len(kind.command) for kind in (leader, *followers))
    return 8 * (numbers + sum(len(kind.pose) for kind in followers))


def _plants_of(scenario: Scenario) -> list[str]:
    return [scenario.leader.plant, *(follower.plant for follower in scenario.followers)]


def _check_views(leader: RobotSetup, followers: Iterable[RobotSetup]) -> None:
    """Refuse followers that cannot follow a leader of this kind."""
    for robot in followers:
        try:
            check_view(robot.vehicle, leader.vehicle)
        except InputError as error:
            raise InputError(f"{robot.name}: {error.message}", robot.where) from None
