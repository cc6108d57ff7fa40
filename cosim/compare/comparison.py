"""Two plants under the same commands from the same pose: how far apart they are."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

import plants
from cosim.compare.excitation import excitation, given, missed
from cosim.compare.lateness import one_step_late
from cosim.errors import InputError, Location, SimulationError, nearest
from cosim.fmu.parameters import ParameterValue, geometry, understand
from cosim.fmu.solver import check_solver, check_step
from cosim.fmu.vehicle import Fmu, open_fmu
from cosim.master.robot_plants import plant, tolerance_of
from cosim.plant.fleet import Fleet
from cosim.plant.spec import CO_SIMULATION, MODEL_EXCHANGE, SOLVERS
from cosim.quantity import split, whole_steps
from cosim.scenario.reader import read_binding
from cosim.scenario.scenario import FIRST_STEP, PlantSource, Setting
from cosim.vehicle.kind import Kind, Role
from plants import UnitError, units

TOLERANCE = 1e-6
"""Default tolerance, in the role's unit."""

MAX_STEPS = 1_000_000


@dataclass(frozen=True)
class PlantFile:
    """A plant to be compared.

    Attributes
    ----------
    fmu : str or Path
        The FMU's file, or the name of a built-in model.
    binding : str, Path or None
        The file with the binding; None if its variables have the names of the roles.
    interface, solver, start : str
        As in a scenario; empty for the default.
    parameters : dict
        Values of parameters as in a scenario, by the parameter's name or the role that it plays.
    """

    fmu: str | Path
    binding: str | Path | None = None
    interface: str = ""
    solver: str = ""
    parameters: Mapping[str, str] = field(default_factory=dict)
    start: str = ""

    def __post_init__(self) -> None:
        for what, said, known in (
            ("interface", self.interface, (CO_SIMULATION, MODEL_EXCHANGE)),
            ("solver", self.solver, SOLVERS),
            ("start", self.start, (FIRST_STEP,)),
        ):
            if said and said not in known:
                raise InputError(f"there is no {what} {said!r}: {nearest(said, list(known))}")


@dataclass(frozen=True)
class RoleDifference:
    """How far apart two plants are in a role, in its unit; an angle by less than half a turn.

    Attributes
    ----------
    role : Role
        The role.
    largest, at, rms : float
        The largest magnitude of the difference, when that is [s], and its root mean square.
    span : float
        Between the smallest and the largest value of the first plant, to compare with.
    tolerance : float
        Largest difference allowed; infinity if any is.
    first_beyond : float or None
        When it is first more than that [s]; None if never.
    moves : bool
        Whether a plant moves by more than the tolerance: if not, a small difference proves nothing.
    """

    role: Role
    largest: float
    at: float
    rms: float
    span: float
    tolerance: float
    first_beyond: float | None
    moves: bool


class PlantFacts(TypedDict):
    """Facts about a plant, for JSON."""

    file: str
    built_in: bool
    sha256: str
    fmi_version: str
    interface: str
    tolerance: float | None
    generation_tool: str | None
    binding: Mapping[str, object]
    parameters: Mapping[str, str]


@dataclass(frozen=True, eq=False)
class PlantComparison:
    """The motions of two plants under the same commands.

    Attributes
    ----------
    kind : Kind
        The kind of vehicle of both.
    plants : tuple of PlantFacts
        Facts about each.
    geometry : dict
        Geometry as controllers know it: each field's value for the first and the second plant.
    step : float
        Communication step [s].
    torque_from : str
        Where the commands come from, in words.
    torque : ndarray (T, commands)
        The commands of each step, torques [N.m] if the vehicle takes torques.
    states : tuple of ndarray (T + 1, entries)
        Pose and pseudo-velocities of each at the communication points, in the roles' units; NaN where a plant does not
        offer one, and after it has failed.
    difference : ndarray (T + 1, entries)
        Of the second from the first.
    roles : tuple of RoleDifference
        Those that both offer.
    failures : tuple of SimulationError
        Why a plant did not reach the end.
    messages : tuple of str
        The FMUs' messages.
    warnings : tuple of str
        Why small differences prove little, in words.
    """

    kind: Kind
    plants: tuple[PlantFacts, PlantFacts]
    geometry: Mapping[str, tuple[float | str | None, float | str | None]]
    step: float
    torque_from: str
    torque: NDArray[np.float64]
    states: tuple[NDArray[np.float64], NDArray[np.float64]]
    difference: NDArray[np.float64]
    roles: tuple[RoleDifference, ...]
    failures: tuple[SimulationError, ...]
    messages: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def time(self) -> NDArray[np.float64]:
        """The communication points [s]."""
        time: NDArray[np.float64] = self.step * np.arange(len(self.torque) + 1, dtype=np.float64)
        return time

    @property
    def within(self) -> bool:
        """Whether both reached the end, no difference is beyond its tolerance, and a plant moves beyond one."""
        reached_and_close = not self.failures and all(role.first_beyond is None for role in self.roles)
        return reached_and_close and any(role.moves for role in self.roles)

    @property
    def late(self) -> str:
        """The plant, "A" or "B", that is one communication step late; empty if neither is."""
        pose = len(self.kind.pose)
        first, second = (states[:, :pose] for states in self.states)
        return one_step_late(first, second, TOLERANCE, [role.unit == "rad" for role in self.kind.pose])

    @property
    def reached(self) -> float:
        """Until when both plants went [s]."""
        rows = np.flatnonzero(np.isfinite(self.difference[:, 0]))
        return round(float(self.time[rows[-1]]), 9) if len(rows) else 0.0

    @property
    def not_offered(self) -> list[str]:
        """Names of the roles that only one of the two plants offers."""
        offered = [found.role.name for found in self.roles]
        return [role.name for role in self.kind.states if role.name not in offered]

    def to_dict(self) -> dict[str, object]:
        """Return all figures as data for JSON; trajectories are left out."""
        return {
            "vehicle": self.kind.name,
            "plants": list(self.plants),
            "geometry": {name: list(values) for name, values in self.geometry.items()},
            "step": self.step,
            "duration": float(self.time[-1]),
            "reached": self.reached,
            "pose": {role.name: float(self.states[0][0, i]) for i, role in enumerate(self.kind.pose)},
            "torque": {
                "from": self.torque_from,
                "largest": {
                    role.name: float(np.abs(self.torque[:, i]).max()) for i, role in enumerate(self.kind.command)
                },
            },
            "differences": {
                found.role.name: {
                    "unit": found.role.unit,
                    "largest": found.largest,
                    "at": found.at,
                    "rms": found.rms,
                    "span": found.span,
                    "tolerance": found.tolerance if math.isfinite(found.tolerance) else None,
                    "first_beyond": found.first_beyond,
                }
                for found in self.roles
            },
            "not_offered": self.not_offered,
            "within": self.within,
            "one_step_late": self.late or None,
            "failures": [str(failure) for failure in self.failures],
            "messages": list(self.messages),
            "warnings": list(self.warnings),
        }


def compare_plants(
    a: str | Path | PlantFile,
    b: str | Path | PlantFile,
    *,
    duration: float = 20.0,
    step: float = 0.02,
    pose: Mapping[str, float] | None = None,
    torque: str | Path | NDArray[np.float64] | None = None,
    seed: int = 1,
    within: Iterable[str] = (),
    isolated: bool = True,
) -> PlantComparison:
    """Drive two plants with the same commands from the same pose.

    Parameters
    ----------
    a, b
        The plants: FMU files, or names of built-in models.
    duration, step
        How long, and the communication step [s].
    pose
        Entries of the initial pose by their roles, in the roles' units. An entry that is left out is the kind's.
    torque
        A CSV file with the columns ``time [s]`` and the commands by their roles, or an array (steps, commands).
        Without it, steps and sines in all, so large that the first plant moves well but steers far from 90 degrees.
    seed
        Of the phases of the sines.
    within
        Largest differences allowed, such as ``1 mm`` (of all lengths) or ``psi=0.1 deg``, each at most once. Without
        any, `TOLERANCE` of all. Each must be of a role that both plants offer.
    isolated
        Whether FMU files run in processes of their own. Built-in models do not.

    Raises
    ------
    InputError
        A file is wrong, the plants are different kinds of vehicles, or one lacks the role of a tolerance.
    SimulationError
        A plant gives no outputs at the start.
    """
    ticks = round(duration / step) if step > 0 and math.isfinite(duration / step) else 0
    if not 1 <= ticks <= MAX_STEPS or abs(ticks * step - duration) > 1e-6 * step:
        such = f", such as {whole_steps(duration / step, step, 1)}" if 1 <= ticks < MAX_STEPS else ""
        raise InputError(
            f"{duration:.12g} s are not a whole number of steps of {step:.12g} s, from 1 to {MAX_STEPS} of them{such}"
        )
    if seed < 0:
        raise InputError(f"the seed {seed} is not a whole number from 0 on")
    first, second = (plant if isinstance(plant, PlantFile) else PlantFile(plant) for plant in (a, b))
    with ExitStack() as cleanup:
        runs = [_Run(name, file, step, ticks, isolated, cleanup) for name, file in (("A", first), ("B", second))]
        kind = runs[0].kind
        if runs[1].kind is not kind:
            raise InputError(
                f"{runs[0].fmu.path.name} is a {kind.name} vehicle, but {runs[1].fmu.path.name} is a "
                f"{runs[1].kind.name}: only vehicles of a kind can be compared"
            )
        tolerances = _tolerances(kind, within, runs)
        start = _pose(kind, pose or {})
        if torque is None:
            torques, said = excitation(kind, lambda torques: runs[0](start, torques).completed, step, ticks, seed)
        else:
            torques, said = given(kind, torque, step, ticks)
        results = [run(start, torques) for run in runs]
        difference = results[1].states - results[0].states
        for column, role in enumerate(kind.states):
            if role.unit == "rad":
                difference[:, column] = np.remainder(difference[:, column] + math.pi, 2 * math.pi) - math.pi
        states = (results[0].states, results[1].states)
        roles = _differences(kind, difference, states, step, tolerances)
        failures = tuple(result.failure for result in results if result.failure is not None)
        return PlantComparison(
            kind=kind,
            plants=(runs[0].about, runs[1].about),
            geometry={name: (value, runs[1].geometry[name]) for name, value in runs[0].geometry.items()},
            step=step,
            torque_from=said,
            torque=torques,
            states=states,
            difference=difference,
            roles=roles,
            failures=failures,
            messages=tuple(message for result in results for message in result.messages),
            warnings=() if failures else _warnings(roles, missed(kind, states[0], step) if torque is None else ""),
        )


# The plants -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Result:
    states: NDArray[np.float64]
    failure: SimulationError | None
    messages: tuple[str, ...]

    @property
    def completed(self) -> NDArray[np.float64] | None:
        """The states, if the plant has not failed."""
        return self.states if self.failure is None else None


class _Run:
    """A plant that can be run from the start, again and again."""

    def __init__(self, name: str, file: PlantFile, step: float, ticks: int, isolated: bool, cleanup: ExitStack) -> None:
        models, asked, exists = plants.models(), str(file.fmu), os.path.exists(file.fmu)
        self.built_in = built_in = asked in models and not exists
        if asked.isidentifier() and not (built_in or exists):  # not the name of a file
            raise InputError(
                f"there is no built-in model {asked!r}, and no FMU of that name: {nearest(asked, [*models])}"
            )
        try:
            path = plants.build(str(file.fmu)) if built_in else Path(file.fmu)
        except plants.PlantError as error:
            raise InputError(str(error)) from None
        self.name, self.step, self.ticks = name, step, ticks
        self.source = PlantSource(
            id=name,
            fmu=path,
            binding=None if file.binding is None else read_binding(file.binding),
            interface=file.interface,
            solver=file.solver,
            late_outputs=bool(file.start),
            isolated=isolated and not built_in,
            parameters=tuple(
                Setting(key, value, Location(f"--parameter {key}={value}")) for key, value in file.parameters.items()
            ),
            where=Location(f"plant {name}"),
        )
        self.fmu: Fmu = open_fmu(path, None, self.source.binding, self.source.interface)
        cleanup.callback(self.fmu.close)
        check_solver(self.fmu, self.source)
        check_step(self.fmu, self.source, step)
        self.parameters: tuple[ParameterValue, ...] = understand(self.fmu, self.source.parameters)
        self.geometry = geometry(self.fmu, self.parameters, self.source.where)

    @property
    def kind(self) -> Kind:
        return self.fmu.binding.kind

    @property
    def about(self) -> PlantFacts:
        """Facts about the plant, for JSON."""
        return {
            "file": str(self.fmu.path),
            "built_in": self.built_in,
            "sha256": self.fmu.sha256,
            "fmi_version": self.fmu.description.fmiVersion,
            "interface": self.fmu.interface,
            "tolerance": tolerance_of(self.fmu, self.source),
            "generation_tool": self.fmu.description.generationTool,
            "binding": self.fmu.binding.described(),
            "parameters": {setting.name: setting.value for setting in self.source.parameters},
        }

    def __call__(self, pose: Sequence[float], torques: NDArray[np.float64]) -> _Result:
        """Run from a pose with commands (T, commands); samples that are not reached are NaN."""
        member = plant(
            self.fmu,
            self.source,
            name=self.name,
            parameters=self.parameters,
            pose=pose,
            given=torques[0].tolist(),
            stop_time=self.ticks * self.step,
        )
        state = np.empty((1, len(self.kind.states)))
        out = np.full((len(torques) + 1, *state.shape), np.nan)
        fleet = Fleet([member], state)
        failure = None
        try:
            out[0] = state
            fleet.run(0, self.step, torques, out[1:])
        except SimulationError as error:
            failure = error
        finally:
            fleet.close()
        return _Result(out[:, 0], failure, tuple(fleet.messages))


def _pose(kind: Kind, entries: Mapping[str, float]) -> tuple[float, ...]:
    known = [role.name for role in kind.pose]
    for name in entries:
        if name not in known:
            raise InputError(f"a {kind.name} vehicle has no pose entry {name!r}: {nearest(name, known)}")
    usual = kind.probe or (0.0,) * len(known)
    return tuple(entries.get(name, value) for name, value in zip(known, usual, strict=True))


# The differences --------------------------------------------------------------------------------------------


def _tolerances(kind: Kind, within: Iterable[str], runs: Sequence[_Run]) -> dict[str, float]:
    """Return the tolerance of each role; if any is given, roles without one are not limited.

    A tolerance of a role that not both plants offer is refused, and so are tolerances of which none is of a role that
    both offer.
    """
    roles = {role.name: role for role in kind.states}
    offered = set(roles).intersection(*(run.fmu.binding.bound for run in runs))
    general: dict[str, float] = {}
    own: dict[str, float] = {}
    idle = ""
    for text in within:
        name, equals, value = text.rpartition("=")
        name = name.strip()
        if equals and name not in roles:
            known = nearest(name, list(roles))
            raise InputError(f"within {text}: a {kind.name} vehicle has no role {name!r} to compare: {known}")
        given = own if equals else general
        fitting = _fitting(text, value, [roles[name]] if equals else list(roles.values()))
        if fitting.keys() & given.keys():
            raise InputError(f"within {text}: a tolerance of {', '.join(fitting)} is given already: give it once")
        if offered.isdisjoint(fitting):
            lacking = " and ".join(
                f"plant {run.name} ({run.fmu.path.name}) offers no {', '.join(names)}"
                for run in runs
                if (names := [name for name in fitting if name not in run.fmu.binding.bound])
            )
            idle = f"within {text}: {lacking}, so it would hold whatever they do: leave it out"
            if equals:
                raise InputError(idle)
        given |= fitting
    found = general | own
    if idle and offered.isdisjoint(found):
        raise InputError(idle)
    return dict.fromkeys(roles, math.inf) | found if found else dict.fromkeys(roles, TOLERANCE)


def _fitting(text: str, value: str, roles: Sequence[Role]) -> dict[str, float]:
    """Return a tolerance for each role with a fitting unit; zero needs no unit."""
    try:
        number, name = split(value)
        given = units.parse(name)
    except (ValueError, UnitError) as error:
        raise InputError(f"within {text}: {error}") from None
    if name == "1" and number != 0:
        examples = " and ".join(f"'{value.strip()} {unit}'" for unit in dict.fromkeys(role.unit for role in roles))
        raise InputError(f"within {text}: has no unit; it may be meant as {examples}")
    found = {}
    for role in roles:
        own = units.parse(role.unit)
        if number == 0 and name == "1":
            found[role.name] = 0.0
        elif own.exponents == given.exponents:
            found[role.name] = number * given.factor / own.factor
    if not found or not 0 <= number < math.inf:
        fitting = ", ".join(dict.fromkeys(role.unit for role in roles))
        raise InputError(f"within {text}: expected a number that is not negative, in a unit such as {fitting}")
    return found


def _differences(
    kind: Kind,
    difference: NDArray[np.float64],
    states: tuple[NDArray[np.float64], NDArray[np.float64]],
    step: float,
    tolerances: Mapping[str, float],
) -> tuple[RoleDifference, ...]:
    found = []
    for column, role in enumerate(kind.states):
        reached = np.isfinite(difference[:, column])
        if not reached.any():
            continue
        course, tolerance = np.abs(difference[reached, column]), tolerances[role.name]
        spans = [float(np.ptp(each[reached, column])) for each in states]
        beyond = np.flatnonzero(course > tolerance)
        found.append(
            RoleDifference(
                role=role,
                largest=float(course.max()),
                at=round(step * int(course.argmax()), 9),
                rms=float(np.sqrt(np.mean(course**2))),
                span=spans[0],
                tolerance=tolerance,
                first_beyond=round(step * int(beyond[0]), 9) if len(beyond) else None,
                moves=max(spans) > tolerance,
            )
        )
    return tuple(found)


def _warnings(roles: Sequence[RoleDifference], missed: str) -> tuple[str, ...]:
    """Return why small differences prove little."""
    limited = [found for found in roles if math.isfinite(found.tolerance)]
    if any(found.moves for found in limited):
        idle = [found for found in limited if found.span <= found.tolerance and found.first_beyond is None]
        said = "A moves by no more than the tolerance in {}: a plant that stands still is within it, too"
    else:
        idle = limited
        said = "neither plant moves by more than the tolerance in {}: this shows nothing, so they are not within it"
    told = [said.format(", ".join(found.role.name for found in idle))] if idle else []
    return (missed, *told) if missed else tuple(told)
