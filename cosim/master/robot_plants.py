"""From a robot of a scenario to a plant of a fleet: the numbers that are exchanged, and the values at the start."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from cosim.fmu.binding import BoundRole, BoundVariable, start_of
from cosim.fmu.interfaces import experiment_number
from cosim.fmu.model_description import Variable
from cosim.fmu.parameters import ParameterValue
from cosim.fmu.solver import usual_step
from cosim.fmu.vehicle import Fmu
from cosim.known import Known
from cosim.master.robot import RobotSetup
from cosim.plant.member import Link, Member
from cosim.plant.spec import MODEL_EXCHANGE, WHOLE, Block, Exchanged, PlantSpec, Value
from cosim.scenario.scenario import (
    DEFAULT_SOLVER,
    DEFAULT_TOLERANCE,
    SUPERVISED_TIME_LIMIT,
    TIME_LIMIT,
    PlantSource,
)
from cosim.vehicle.kind import Role

DIVERGED_POSE = 1e9
"""A pose entry beyond this magnitude [m, rad] is taken for divergence."""
DIVERGED_VELOCITY = 1e6
"""A pseudo-velocity beyond this magnitude [m/s, rad/s] is taken for divergence."""


def member(robot: RobotSetup, stop_time: float, columns: tuple[int, ...] = (), known: Known | None = None) -> Member:
    """Return the plant of a robot.

    Parameters
    ----------
    robot
        The robot.
    stop_time
        End of the run [s].
    columns
        Columns of its pose and velocities in a row of the state; empty: one after the other.
    known
        What is known from other runs.
    """
    return plant(
        robot.fmu,
        robot.source,
        name=robot.name,
        parameters=robot.parameters,
        pose=robot.pose,
        inputs=robot.inputs,
        given=(*robot.torque[0].tolist(), *robot.samples[0].tolist()),
        held=robot.held,
        stop_time=stop_time,
        columns=columns,
        known=known,
    )


def plant(
    fmu: Fmu,
    source: PlantSource,
    *,
    name: str,
    parameters: Sequence[ParameterValue],
    pose: Sequence[float],
    inputs: Iterable[BoundRole] = (),
    given: Sequence[float] = (),
    held: Iterable[ParameterValue] = (),
    stop_time: float,
    columns: tuple[int, ...] = (),
    known: Known | None = None,
) -> Member:
    """Return an FMU as a plant.

    Parameters
    ----------
    fmu, source
        The FMU, and its <plant> in the scenario.
    name
        Name in messages and of the FMU's instance.
    parameters
        Parameters that are set.
    pose
        Initial pose in the kind's order and units.
    inputs
        Inputs besides the torques that get values.
    given
        Values of the torques and these inputs at the start, in the roles' units; empty for the FMU's start values.
    held
        Inputs that keep their values until they are changed, at the start.
    stop_time
        End of the run [s].
    columns, known
        As for `member`.
    """
    description, binding, kind = fmu.description, fmu.binding, fmu.binding.kind
    states, known = kind.states, known or Known()
    bounds = (*[DIVERGED_POSE] * len(kind.pose), *[DIVERGED_VELOCITY] * len(kind.velocity))
    driven = (*(binding.bound[role.name] for role in kind.command), *inputs)
    players = tuple(binding.of(states))
    input_block, inputs_linked = known.of(
        (name, "inputs"), _exchanged, driven, tuple(given), tuple(bound.role for bound in driven), ()
    )
    presumed = (*pose, *[0.0] * len(kind.velocity)) if source.late_outputs else ()
    output_block, outputs_linked = known.of((name, "outputs"), _exchanged, players, presumed, states, bounds)
    spec = PlantSpec(
        robot=name,
        file=fmu.path.name,
        directory=str(fmu.directory),
        fmi=description.fmiVersion,
        interface=fmu.interface,
        identifier=fmu.about_interface.modelIdentifier,
        token=description.guid or "",
        values=(
            *(parameter.as_value for parameter in parameters if not parameter.is_input),
            *known.of(name, _initial_values, fmu, tuple(pose)),
        ),
        inputs=input_block,
        outputs=output_block,
        stop_time=stop_time,
        states=description.numberOfContinuousStates,
        event_indicators=description.numberOfEventIndicators,
        completed_steps=description.fmiVersion == "1.0"
        or bool(getattr(fmu.about_interface, "needsCompletedIntegratorStep", False)),
        solver=source.solver or DEFAULT_SOLVER,
        solver_steps=source.solver_steps or 1,
        tolerance=tolerance_of(fmu, source),
        late_outputs=source.late_outputs,
        time_limit=_time_limit(fmu, source),
        logging=source.logging,
        held=tuple(value.as_value for value in (*(p for p in parameters if p.is_input), *held)),
    )
    return Member(
        spec=spec,
        inputs=inputs_linked,
        outputs=outputs_linked,
        pose=tuple(pose),
        isolated=in_own_process(fmu, source),
        alone=each_alone(fmu, source),
        needs_tool=bool(fmu.about_interface.needsExecutionTool),
        usual_step=usual_step(fmu),
        where=source.where,
        columns=columns,
    )


def tolerance_of(fmu: Fmu, source: PlantSource) -> float | None:
    """Return the relative tolerance of CVODE, or the one that a Co-Simulation FMU gets for its own solver.

    Without one in the scenario, an FMU gets the tolerance of its default experiment, if that is positive; so does FMPy.
    None for a built-in model, which has a parameter for it, and for an FMU without one.
    """
    if fmu.interface == MODEL_EXCHANGE:
        return (source.tolerance or DEFAULT_TOLERANCE) if source.solver == "cvode" else None
    if source.model is not None or fmu.description.fmiVersion == "1.0":
        return None
    return source.tolerance or experiment_number(fmu.description, "tolerance")


def in_own_process(fmu: Fmu, source: PlantSource) -> bool:
    """Return whether an FMU runs in a process of its own, because the scenario, the caller or the FMU needs it."""
    return source.isolated or source.contained or bool(why_own_process(fmu))


def each_alone(fmu: Fmu, source: PlantSource) -> bool:
    """Return whether each robot has such a process of its own, and not all robots of the FMU together."""
    return source.apart or fmu.about_interface.canBeInstantiatedOnlyOncePerProcess


def why_own_process(fmu: Fmu) -> str:
    """Return why an FMU must run in processes of its own, with the FMU as the subject; empty if it need not."""
    if fmu.about_interface.canBeInstantiatedOnlyOncePerProcess:
        return "can be instantiated only once in a process"
    return f"brings {fmu.brought_code}" if fmu.brought_code else ""


def _time_limit(fmu: Fmu, source: PlantSource) -> float:
    """Return the time limit of the scenario; else a shorter one where a process was asked for, or declared."""
    if source.time_limit is not None:
        return source.time_limit
    declared = source.isolated or fmu.about_interface.canBeInstantiatedOnlyOncePerProcess
    return TIME_LIMIT if declared else SUPERVISED_TIME_LIMIT


def _exchanged(
    players: Sequence[BoundRole | None], values: Sequence[float], roles: Sequence[Role], bounds: Sequence[float]
) -> tuple[Block, tuple[Link, ...]]:
    """Return the block of the variables that play roles, see `_block`, and the link of each role, with its bound."""
    block, places = _block(players, values)
    return block, tuple(
        _link(role, None if player is None else player.played_by, place, bound_by=most)
        for role, player, place, most in zip(roles, players, places, bounds or [np.inf] * len(places), strict=True)
    )


def _block(roles: Sequence[BoundRole | None], values: Sequence[float] = ()) -> tuple[Block, list[int]]:
    """Return the block of the variables that play roles, and the place of each role in it; -1 for a role without one.

    The block starts with the roles' values, in the roles' units; without values, with the FMU's start values.
    """
    first: dict[tuple[str, int], int] = {}  # by type and value reference
    variables: list[Exchanged] = []
    start: list[float] = []
    places = []
    for bound in roles:
        if bound is None or bound.played_by is None:
            places.append(-1)
            continue
        variable = bound.played_by.variable
        key = (variable.type, variable.valueReference)
        if key not in first:
            first[key] = len(start)
            start += start_of(variable)
            variables.append(Exchanged(variable.name, variable.type, len(start) - first[key]))
        places.append(first[key] + bound.played_by.element)
    for bound, place, value in zip(roles, places, values, strict=False):
        if bound is not None and bound.played_by is not None:
            start[place] = (value - bound.played_by.offset) / bound.played_by.scale
    return Block(tuple(reference for _, reference in first), tuple(start), tuple(variables)), places


def _link(role: Role, bound: BoundVariable | None, place: int, *, bound_by: float = np.inf) -> Link:
    scale, offset = (1.0, 0.0) if bound is None else (bound.scale, bound.offset)
    resolution = 0.5 * abs(scale) if bound is not None and bound.variable.type in WHOLE else 0.0
    return Link(role.name, role.unit, place, scale, offset, bound_by, resolution)


def _initial_values(fmu: Fmu, pose: Sequence[float]) -> tuple[Value, ...]:
    """Return the start values that put a plant at its initial pose; of an array, all of its elements."""
    values: dict[tuple[str, int], tuple[Variable, list[float]]] = {}
    for bound, entry in zip(fmu.binding.of(fmu.binding.kind.pose), pose, strict=True):
        assert bound is not None
        assert bound.initial is not None
        variable = bound.initial.variable
        start = list(start_of(variable))
        _, elements = values.setdefault((variable.type, variable.valueReference), (variable, start))
        elements[bound.initial.element] = (entry - bound.initial.offset) / bound.initial.scale
    return tuple(
        Value(
            variable.name,
            variable.type,
            variable.valueReference,
            tuple(map(round, elements) if variable.type in WHOLE else elements),
        )
        for variable, elements in values.values()
    )
