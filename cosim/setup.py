"""A scenario with everything that it names: found, checked and fitting together, and nothing started yet."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import plants
from cosim.contract import Contract
from cosim.errors import InputError
from cosim.fmu import Fmu, open_fmu
from cosim.parameters import ParameterValue, understand
from cosim.recorder import Channel
from cosim.scenario import PlantSource, Scenario
from cosim.summary import check_expectations
from cosim.team import Law, find_law
from cosim.timing import timed

MAX_RECORD_BYTES = 4 * 1024**3

RESERVED = ("time", "robot", "range", "bearing", "range_error", "bearing_error")
"""Names in a result that no channel can have: dimensions, and what follows from the channels."""


@dataclass(frozen=True)
class Setup:
    """What a scenario is run with.

    Attributes
    ----------
    contract : Contract
        The kind of vehicle that all robots are.
    fmus, parameters : dict
        The FMU and the parameters of each plant that is used, by its id.
    laws : dict
        The control law of each controller that is used, by its id.
    channels : tuple of Channel
        What is recorded.
    """

    contract: Contract
    fmus: Mapping[str, Fmu]
    parameters: Mapping[str, tuple[ParameterValue, ...]]
    laws: Mapping[str, Law]
    channels: tuple[Channel, ...]


def set_up(scenario: Scenario, cleanup: ExitStack, timing: dict[str, float]) -> Setup:
    """Find and check what a scenario names. Built-in plants are built if they are not in the cache.

    Parameters
    ----------
    scenario
        The scenario.
    cleanup
        Gets what must be undone in the end.
    timing
        Gets the seconds that were spent, by part.

    Raises
    ------
    InputError
        Something does not exist or does not fit, with the place in the scenario.
    """
    used = {scenario.leader.plant, *(follower.plant for follower in scenario.followers)}
    fmus = {}
    for source in scenario.plants.values():
        if source.id in used:
            with timed(timing, "build"):
                path = _fmu_path(source)
            with timed(timing, "load"):
                fmus[source.id] = open_fmu(path, source.where)
            cleanup.callback(fmus[source.id].close)
    _check_instances(scenario, fmus)
    contract = _shared_contract(fmus)
    parameters = {name: understand(fmu, scenario.plants[name].parameters) for name, fmu in fmus.items()}
    with timed(timing, "controllers"):
        controlling = {follower.controller for follower in scenario.followers}
        laws = {name: find_law(source) for name, source in scenario.controllers.items() if name in controlling}
    channels = _channels(contract, len(scenario.followers), laws.values())
    size = (scenario.ticks + 1) * sum(channel.bytes_per_sample for channel in channels)
    if size > MAX_RECORD_BYTES:
        raise InputError(
            f"the scenario {scenario.name!r} would record {size / 1024**3:.1f} GiB, more than "
            f"{MAX_RECORD_BYTES // 1024**3} GiB: shorten its horizon or lengthen its step"
        )
    single = {channel.name: channel.units for channel in channels if channel.dims == ("robot",)}
    single |= {"range": "m", "bearing": "rad", "range_error": "m", "bearing_error": "rad"}
    check_expectations(scenario.expectations, single)
    return Setup(contract, fmus, parameters, laws, channels)


def _fmu_path(source: PlantSource) -> Path:
    if source.fmu is not None:
        return source.fmu
    assert source.model is not None
    try:
        return plants.build(source.model)
    except plants.PlantError as error:
        raise InputError(str(error), source.where) from None


def _check_instances(scenario: Scenario, fmus: Mapping[str, Fmu]) -> None:
    robots = [scenario.leader.plant, *(follower.plant for follower in scenario.followers)]
    for name, fmu in fmus.items():
        if fmu.description.coSimulation.canBeInstantiatedOnlyOncePerProcess and robots.count(name) > 1:
            raise InputError(
                f"the FMU {fmu.path} can be instantiated only once, but {robots.count(name)} robots are this plant",
                scenario.plants[name].where,
            )


def _shared_contract(fmus: Mapping[str, Fmu]) -> Contract:
    contracts = {fmu.binding.contract.vehicle: fmu.binding.contract for fmu in fmus.values()}
    if len(contracts) > 1:
        raise InputError(f"a formation of different vehicles ({', '.join(contracts)}) is not possible yet")
    return next(iter(contracts.values()))


def _channels(contract: Contract, n: int, laws: Iterable[Law]) -> tuple[Channel, ...]:
    pose, velocity, torque = (
        ", ".join(role.unit for role in roles) for roles in (contract.pose, contract.velocity, contract.torque)
    )
    channels = {
        channel.name: channel
        for channel in (
            Channel("leader_pose", ("pose_component",), (4,), pose, "pose of the virtual leader"),
            Channel("leader_velocity", ("velocity_component",), (2,), velocity, "velocities of the virtual leader"),
            Channel("leader_torque", ("torque_component",), (2,), torque, "torque that drives the virtual leader"),
            Channel("pose", ("robot", "pose_component"), (n, 4), pose, "pose"),
            Channel("velocity", ("robot", "velocity_component"), (n, 2), velocity, "pseudo-velocities"),
            Channel("measured_pose", ("robot", "pose_component"), (n, 4), pose, "pose as measured"),
            Channel("torque", ("robot", "torque_component"), (n, 2), torque, "torque as applied"),
            Channel("desired_range", ("robot",), (n,), "m", "desired range"),
            Channel("desired_bearing", ("robot",), (n,), "rad", "desired bearing"),
        )
    }
    taken = {*channels, *RESERVED, *(dim for channel in channels.values() for dim in channel.dims)}
    telemetry: dict[str, tuple[Any, Channel]] = {}
    for law in laws:
        for signal in law.controller_type.signals:
            parts = signal.components
            dims = ("robot", f"{signal.name}_component") if parts else ("robot",)
            shape = (n, len(parts)) if parts else (n,)
            if signal.name in taken or telemetry.get(signal.name, (signal,))[0] != signal:
                raise InputError(
                    f"controller {law.source.id!r}: its signal {signal.name!r} has the name of another in the result",
                    law.source.where,
                )
            about = (signal.unit, signal.description, signal.singular_at_zero, float(signal.singular_below))
            telemetry[signal.name] = (signal, Channel(signal.name, dims, shape, *about))
    return (*channels.values(), *(channel for _, channel in telemetry.values()))
