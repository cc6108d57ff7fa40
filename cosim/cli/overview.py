"""A scenario at a glance: robots, plants, events and expectations."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from rich.console import Console

from cosim.cli.console import broken, safe, say, table
from cosim.fmu.capabilities import NAMES
from cosim.fmu.solver import usual_step
from cosim.master.foreign import for_whole_run, is_supervised
from cosim.master.robot_plants import each_alone, in_own_process, tolerance_of, why_own_process
from cosim.master.setup import Setup
from cosim.plant.constant_step import misfit
from cosim.plant.spec import CO_SIMULATION, MODEL_EXCHANGE
from cosim.results.expectations import understood
from cosim.scenario import in_words
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import (
    DEFAULT_SOLVER,
    DEFAULT_TOLERANCE,
    EffectSource,
    Expectation,
    Follower,
    InputSource,
    Leader,
    PlantSource,
    Scenario,
    Trajectory,
)
from cosim.signals.effects import understood as understood_effects
from cosim.signals.waves import understood as understood_wave
from cosim.vehicle.kind import Role, units_of

NARROW = 100
"""Columns of a terminal below which names of plants and controllers are broken."""


def print_overview(console: Console, scenario: Scenario, setup: Setup, described: Iterable[str]) -> None:
    """Print tables of a scenario's robots, its plants, events and expectations."""
    times = Times(scenario.step, scenario.ticks)
    kinds = [robot.kind for robot in setup.followers]
    sensing = [_effects(f.sensor, kind.pose, times) for f, kind in zip(scenario.followers, kinds, strict=True)]
    acting = [_effects(f.actuator, kind.command, times) for f, kind in zip(scenario.followers, kinds, strict=True)]
    sensors, actuators = (Counter(texts).most_common(1)[0][0] for texts in (sensing, acting))
    robots = table(console, safe(f"{scenario.name}: {scenario.title}"))
    width = console.width if console.width >= NARROW else console.width // 6
    for heading in (
        "robot",
        "plant",
        "controller" if console.width >= NARROW else "con-\ntroller",
        "place",
        "own settings",
    ):
        robots.add_column(heading, no_wrap=heading == "robot")
    leader = scenario.leader
    plants = {
        key: broken(f"{key} ({source.model or Path(str(source.fmu)).name})", width)
        for key, source in scenario.plants.items()
    }
    laws = {key: broken(f"{key} ({source.name})", width) for key, source in scenario.controllers.items()}
    robots.add_row("leader", safe(plants[leader.plant]), "", "", safe("\n".join(_own_of_leader(leader, setup, times))))
    for follower, sensor, actuator in zip(scenario.followers, sensing, acting, strict=True):
        own = [*in_words.settings(follower.parameters), *in_words.settings(follower.gains)]
        own += [f"sensor: {sensor}"] if sensor != sensors else []
        own += [f"actuator: {actuator}"] if actuator != actuators else []
        own += _inputs(follower.inputs)
        sources = (plants[follower.plant], laws[follower.controller])
        robots.add_row(*map(safe, (follower.id, *sources, "\n".join(_places(follower)), "\n".join(own))))
    console.print(robots)
    for text in described:
        say(console, safe(text))
    for text in _described_laws(setup):
        say(console, safe(text))
    for what, text in (("sensor", sensors), ("actuator", actuators)):
        say(console, f"{what} of followers, where no other is shown: {safe(text)}")
    for text in _inputs(scenario.inputs):
        say(console, f"{safe(text)}, for every follower")
    for event in scenario.events:
        say(console, f"at {event.time:.12g} s, {safe(event.robot)}: {safe(in_words.event(event))}")
    for expectation in scenario.expectations:
        say(console, f"expected: {safe(_expected(expectation))}")


def doubtful_plants(scenario: Scenario, setup: Setup) -> Iterator[str]:
    """Return doubts about plants, as far as their files show them."""
    for name, fmu in setup.fmus.items():
        if doubt := misfit(usual_step(fmu), scenario.step):
            yield f"plant {name}: {fmu.path.name} {doubt}"


def described_plants(scenario: Scenario, setup: Setup) -> Iterator[str]:
    """Return how each FMU is run and the players of its roles; for a built-in model only unusual settings."""
    scenario = for_whole_run(scenario)
    shared = "supervised" if is_supervised(scenario) else "in the harness"
    for name, fmu in setup.fmus.items():
        source, how = scenario.plants[name], shared
        if in_own_process(fmu, source):
            how = f"{'each robot' if each_alone(fmu, source) else 'its robots'} in a process of "
            how += "its own" if each_alone(fmu, source) else "their own"
        if not source.isolated and (why := why_own_process(fmu)):
            how += f", as it {why}"
        if source.model is not None:
            if in_own_process(fmu, source):
                yield f"plant {name}: {how}"
            continue
        solver = f", {_solver(source, scenario.step)}" if fmu.interface == MODEL_EXCHANGE else ""
        if fmu.interface == CO_SIMULATION and (tolerance := tolerance_of(fmu, source)) is not None:
            solver = f", with a tolerance of {tolerance:g}"
        late = ", outputs read from the first step on" if source.late_outputs else ""
        players = {role: player for role, player in fmu.binding.described().items() if player != role}
        roles = [f"{role}: {player}" for role, player in players.items()]
        if len(players) < len(fmu.binding.bound):
            roles.append(f"all {'other ' if players else ''}roles by their names")
        version = f"FMI {fmu.description.fmiVersion} {NAMES[fmu.interface]}"
        yield f"plant {name}: {fmu.path.name}, {version}{solver}, {how}{late}; {'; '.join(roles)}"


def _described_laws(setup: Setup) -> Iterator[str]:
    """Return where each law runs that has an environment of its own."""
    for name, law in setup.laws.items():
        if law.host is not None:
            versions = ", ".join(f"{of} {version}" for of, version in law.environment.items())
            yield f"controller {name}: {law.package} {law.version} in {law.host.shown}, with {versions}"


# In words ---------------------------------------------------------------------------------------------------


def _solver(source: PlantSource, step: float) -> str:
    name = source.solver or DEFAULT_SOLVER
    if name == "cvode":
        return f"{name} with a tolerance of {source.tolerance or DEFAULT_TOLERANCE:g}"
    return f"{name} in steps of {step / (source.solver_steps or 1):.12g} s"


def _own_of_leader(leader: Leader, setup: Setup, times: Times) -> Iterator[str]:
    if leader.trajectory is not None:
        yield _trajectory(leader.trajectory)
    elif leader.torque.values:
        yield in_words.commands(leader.torque.values.items())
    yield from in_words.settings(leader.parameters)
    if leader.sensor:
        yield f"sensor of its pose: {_effects(leader.sensor, setup.leader.kind.pose, times)}"
    yield from _inputs(leader.inputs)


def _trajectory(trajectory: Trajectory) -> str:
    of = trajectory.file.name if trajectory.file is not None else f"{len(trajectory.waypoints)} waypoints"
    return f"trajectory from {of}"


def _places(follower: Follower) -> Iterator[str]:
    yield _place(*follower.desired)
    for change in follower.changes:
        yield f"{change.start:.12g} to {change.stop:.12g} s: {_place(change.range, change.bearing)}"


def _place(distance: float, bearing: float) -> str:
    return f"{distance:g} m, {math.degrees(bearing):g} deg"


def _effects(sources: Sequence[EffectSource], roles: Iterable[Role], times: Times) -> str:
    """Return effects in words; effects that differ only in their channels are joined."""
    channels: dict[tuple[str, str], list[str]] = {}
    for effect in understood_effects(sources, units_of(roles), times, ""):
        about = (effect.text, _window(effect.start, effect.stop, math.inf))
        channels.setdefault(about, []).extend(effect.channels)
    return (
        "; ".join(
            what + (f" ({', '.join(names)})" if names else "") + window for (what, window), names in channels.items()
        )
        or "none"
    )


def _window(start: float, stop: float, end: float) -> str:
    return (f" from {start:.12g} s" if start > 0 else "") + (f" to {stop:.12g} s" if stop < end else "")


def _inputs(inputs: Iterable[InputSource]) -> Iterator[str]:
    for source in inputs:
        waves = (understood_wave(wave).text for wave in source.waves)
        yield f"input {source.name}: {' + '.join(waves)}"


def _expected(expectation: Expectation) -> str:
    robots, fails = expectation.robots, expectation.get("fails")
    text = understood(expectation).overview + (f" ({', '.join(robots)})" if robots else "")
    return text + (f"; known to fail: {fails}" if fails else "")
