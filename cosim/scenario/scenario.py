"""The content of a scenario file, as plain data in SI units; `cosim.scenario.reader` reads it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NoReturn

from cosim.clock import Clock
from cosim.errors import InputError, Location
from cosim.scenario.edits import Change, as_changes
from cosim.scenario.written_element import Written

LEADER = "leader"

FIRST_STEP = "first_step"
"""From when on the outputs of a plant count, where that is not the start."""

DEFAULT_SOLVER = "runge_kutta_4"
"""Solvers of Model Exchange."""
DEFAULT_TOLERANCE = 1e-6
"""Relative tolerance of solvers with variable steps."""
TIME_LIMIT = 10.0
"""Default time limit [s] of a plant in a process of its own, for the start, for a step and for the end."""
SUPERVISED_TIME_LIMIT = 60.0
"""The same in the supervised process, where nobody has asked for a limit."""

OPEN = "..."
"""Stands in a binding for text that the user must fill in."""


@dataclass(frozen=True)
class Setting:
    """A named value as it is written, to be understood by whom it is for (a plant, a controller)."""

    name: str
    value: str
    where: Location


@dataclass(frozen=True)
class Entries:
    """Values [SI] by the names of a vehicle's pose entries or torques; its plant has the names."""

    values: Mapping[str, float]
    where: Location


@dataclass(frozen=True)
class RoleSource:
    """A role in a binding.

    Attributes
    ----------
    name : str
        The role.
    variable : str
        The FMU's variable that plays it; empty if `value` is given.
    unit : str
        The variable's unit, where the FMU states none.
    factor, offset : str
        Quantities: the value is the factor times the variable, plus the offset. Empty for 1 and 0.
    initial : str
        The parameter that gives the initial value; empty if the variable's start value does.
    value : str
        A constant value instead of a variable.
    where : Location or None
        Its place in the file; None if no binding states it.
    """

    name: str
    variable: str = ""
    unit: str = ""
    factor: str = ""
    offset: str = ""
    initial: str = ""
    value: str = ""
    where: Location | None = None


@dataclass(frozen=True)
class BindingSource:
    """The variables of an FMU that play the roles of a vehicle."""

    vehicle: str
    roles: tuple[RoleSource, ...]
    where: Location


@dataclass(frozen=True)
class PlantSource:
    """A kind of vehicle: a built-in model or an FMU file, with parameters.

    Attributes
    ----------
    binding : BindingSource or None
        The variables of the FMU by their roles; None if they have the roles' names.
    interface : str
        ``co_simulation`` or ``model_exchange``; empty for the first one that the FMU offers, Co-Simulation first.
    solver : str
        Of a Model Exchange FMU; empty for the default.
    solver_steps : int or None
        Number of solver steps in a communication step; None if not stated, for one.
    tolerance : float or None
        Relative tolerance of cvode, or of the solver that a Co-Simulation FMU brings; None if not stated.
    late_outputs : bool
        Whether its outputs count only from the first step on, and it is taken to stand at its pose until then.
    isolated : bool
        Whether its FMU runs in a process of its own, for all its robots.
    contained : bool
        Whether it does so although nobody has asked for it, as it is not to run in the process of the caller.
    apart : bool
        Whether each robot's FMU runs in a process of its own.
    trusted : bool
        Whether it may run in the process that judges and writes.
    logging : bool
        Whether the FMU is asked to log everything.
    time_limit : float or None
        What it may take [s] for its start, a step and its end; None if not stated.
    """

    id: str
    where: Location
    model: str | None = None
    fmu: Path | None = None
    binding: BindingSource | None = None
    interface: str = ""
    solver: str = ""
    solver_steps: int | None = None
    tolerance: float | None = None
    late_outputs: bool = False
    isolated: bool = False
    contained: bool = False
    apart: bool = False
    trusted: bool = False
    time_limit: float | None = None
    logging: bool = False
    parameters: tuple[Setting, ...] = ()


@dataclass(frozen=True)
class ControllerSource:
    """A control law by name, package and version range, with gains.

    Attributes
    ----------
    environment : Path or None
        The folder of the Python environment in which it runs; None for the harness's own.
    time_limit : float or None
        What a tick may take there [s]; None if not stated.
    """

    id: str
    name: str
    package: str
    version: str
    gains: tuple[Setting, ...]
    where: Location
    environment: Path | None = None
    time_limit: float | None = None


@dataclass(frozen=True)
class EffectSource(Written):
    """An effect of a sensor or an actuator, as it is written; `cosim.signals.effects` understands it.

    Attributes
    ----------
    start, stop : float
        The window [s], the second excluded.
    """

    start: float
    stop: float

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the pose entries or commands that are named; empty for all."""
        return tuple(self.get("channels").split())


@dataclass(frozen=True)
class WaveSource(Written):
    """One of the waves that an input is the sum of, as it is written; `cosim.signals.waves` understands it.

    Attributes
    ----------
    start, stop : float
        Its begin and end [s]; a ramp rises between them.
    """

    start: float
    stop: float


@dataclass(frozen=True)
class InputSource:
    """A sum of waves that is added to an input of a plant."""

    name: str
    waves: tuple[WaveSource, ...]
    where: Location


@dataclass(frozen=True)
class Trajectory:
    """A given path: waypoints (time [s], x [m], y [m]) or a file, and by how much [m] the path may miss the points."""

    waypoints: tuple[tuple[float, float, float], ...]
    file: Path | None
    smoothing: float
    where: Location


@dataclass(frozen=True)
class Leader:
    """The virtual leader: its initial pose and torques, or the path that it takes."""

    plant: str
    pose: Entries
    torque: Entries
    trajectory: Trajectory | None
    parameters: tuple[Setting, ...]
    sensor: tuple[EffectSource, ...]
    inputs: tuple[InputSource, ...]
    where: Location


@dataclass(frozen=True)
class PlaceChange:
    """A change of a follower's place from one time to another [s], to a range [m] and bearing [rad]."""

    start: float
    stop: float
    range: float
    bearing: float
    where: Location


@dataclass(frozen=True)
class Follower:
    """A follower: initial pose, desired range [m] and bearing [rad] with their changes, and settings of its own."""

    id: str
    plant: str
    controller: str
    pose: Entries
    desired: tuple[float, float]
    changes: tuple[PlaceChange, ...]
    parameters: tuple[Setting, ...]
    gains: tuple[Setting, ...]
    sensor: tuple[EffectSource, ...]
    actuator: tuple[EffectSource, ...]
    inputs: tuple[InputSource, ...]
    where: Location


@dataclass(frozen=True)
class Event:
    """A change of a robot at a time [s]: parameters or inputs change, the leader's torque changes, or it stops."""

    time: float
    robot: str
    parameters: tuple[Setting, ...]
    inputs: tuple[Setting, ...]
    torque: Entries | None
    stops: bool
    where: Location


@dataclass(frozen=True)
class Expectation(Written):
    """Something that must hold for the run to pass, as it is written; `cosim.results.expectations` understands it.

    Attributes
    ----------
    start, stop : float
        The window [s], both ends included.
    robots : tuple of str
        The followers of whom it is expected; empty for all.
    """

    start: float
    stop: float
    robots: tuple[str, ...]

    def __hash__(self) -> int:
        return hash((self.kind, self.where, self.start, self.stop))


def _unread(scenario: Scenario, changes: Sequence[Change]) -> NoReturn:
    raise InputError(f"the scenario {scenario.name!r} was not read from a file, so it cannot be edited")


@dataclass(frozen=True)
class Scenario:
    """One experiment.

    Attributes
    ----------
    step : float
        Communication step [s].
    ticks : int
        Communication steps of the run; the horizon is ``ticks * step``.
    period : int
        Communication steps from one tick of the controllers to the next.
    sensor, actuator : tuple of EffectSource
        Those of every follower without one of its own.
    inputs : tuple of InputSource
        Those of every follower.
    text : str
        The resolved document.
    where : Location
        Where horizon and step are written.
    changes : tuple of str
        Changes made after it was read, as options of the command line.
    untrusted : tuple of Path
        Folders whose FMUs run in processes of their own.
    places : tuple of Location
        Where each element of the text was written, in the order of the text.
    folder : Path
        The file's folder; paths in the text are relative to it, also when the text is read again elsewhere.
    read_again : callable
        Reads the text with more changes. It is the reader, handed in because this module must not import it.
    """

    path: Path
    text: str
    name: str
    title: str
    step: float
    ticks: int
    period: int
    seed: int
    plants: Mapping[str, PlantSource]
    controllers: Mapping[str, ControllerSource]
    sensor: tuple[EffectSource, ...]
    actuator: tuple[EffectSource, ...]
    inputs: tuple[InputSource, ...]
    leader: Leader
    followers: tuple[Follower, ...]
    events: tuple[Event, ...]
    expectations: tuple[Expectation, ...]
    where: Location
    changes: tuple[str, ...] = ()
    untrusted: tuple[Path, ...] = ()
    places: tuple[Location, ...] = field(default=(), repr=False)
    folder: Path = Path()
    read_again: Callable[[Scenario, Sequence[Change]], Scenario] = field(default=_unread, repr=False, compare=False)

    def __hash__(self) -> int:
        return hash((self.path, self.text))

    def edited(
        self, changes: Iterable[str | Change] = (), *, horizon: float | str | None = None, expectations: bool = True
    ) -> Scenario:
        """Return the scenario with changes; only files with bindings are read.

        Parameters
        ----------
        changes
            ``XPATH=VALUE`` each, as for ``--set``, or one of `cosim.scenario.edits`.
        horizon
            Another end of the run, in seconds or as in "100 s". Elements that begin later are left out, and up to
            there the run is the same. An expectation about a later time is refused.
        expectations
            False leaves the expectations out.

        Raises
        ------
        InputError
            A change does not apply, or the scenario does not make sense any more; with its place.

        Examples
        --------
        >>> scenario.edited(horizon=2.0, expectations=False)
        >>> scenario.edited(["//gain[@name='K_p']/@value=12", "simulation/@seed=3"])
        """
        made = as_changes(changes, horizon, expectations)
        return self.read_again(self, made) if made else self

    @cached_property
    def events_by_robot(self) -> Mapping[str, tuple[Event, ...]]:
        """The events of each robot that has some, in the order of time."""
        found: dict[str, list[Event]] = {}
        for event in self.events:
            found.setdefault(event.robot, []).append(event)
        return {robot: tuple(events) for robot, events in found.items()}

    @property
    def horizon(self) -> float:
        """The end of the run [s]."""
        return self.clock.horizon

    @property
    def clock(self) -> Clock:
        """The communication points."""
        return Clock(self.step, self.ticks)
