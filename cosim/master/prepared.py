"""A scenario that is prepared once and run often, with other values each time."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.closing import Closing
from cosim.errors import Failure, InputError, OtherStructure, SimulationError, nearest
from cosim.known import Known
from cosim.master.fleets import AnyFleet, members_of
from cosim.master.foreign import contained
from cosim.master.other_runs import run_other
from cosim.master.recorded_result import only_signals, recorded_result
from cosim.master.recorder import Recorder
from cosim.master.robot import RobotSetup
from cosim.master.setup import Setup, set_up
from cosim.master.simulation import Simulation
from cosim.master.structure import structure
from cosim.master.ticks import driven_robots
from cosim.plant.fleet import Fleet
from cosim.results.expectations import judge, needed, needs_outlines
from cosim.results.follower_figures import NEEDED, follower_figures
from cosim.results.outcome import RunOutcome
from cosim.results.result import Result
from cosim.results.verdict import Verdict
from cosim.scenario.edits import Change
from cosim.scenario.reader import Variations
from cosim.scenario.scenario import Scenario
from cosim.undisturbed import Ending
from cosim.unforeseen import lack_of

Floats: TypeAlias = NDArray[np.float64]

EVERYTHING = "everything"
"""In place of names of signals: all of them are recorded."""


class Prepared(Closing):
    """The structure of a scenario: its plants are built, loaded and started once, for any number of runs.

    A run has the scenario's robots, plants, step and horizon, and any seed and values: masses, gains, noise, starts,
    places, torques, events. Its numbers are those of the same scenario run alone, bit for bit: plants are reset and get
    all of their values, laws and random numbers begin anew, and whatever happened in a run, the next one does not see
    it. An FMU that refuses to be reset, or that has failed, is started anew.

    FMU files run in processes of their own, as by ``isolate="process"``, which stay from run to run: whatever an FMU
    does there ends its run alone, as a failure. ``isolate="no"`` in the scenario lets them run in this process.

    An FMU that is not one of the built-in models may reset itself wrongly. So the first run after a reset is also made
    with new instances; if they differ in one bit, new ones are started for every run.

    Legal call order: `run` in any number, by one thread at a time; `close` at the end (or use ``with``).

    Parameters
    ----------
    scenario
        The scenario.
    record
        The signals that outcomes hold, by name; `EVERYTHING` for all. None: outcomes hold no signals, and only those
        are recorded that expectations and figures need.
    isolate
        Whether FMU files of which the scenario does not say so run in processes of their own; if not, in this one.

    Attributes
    ----------
    resets : bool
        Whether FMUs are reset; False once one has turned out to do it wrongly.

    Raises
    ------
    InputError
        The scenario asks for something that does not exist or does not fit; or it records no such signal.

    Examples
    --------
    >>> with cosim.Prepared(cosim.read_scenario("scenarios/clmr_line.xml")) as prepared:
    ...     for mass in range(20, 60):
    ...         outcome = prepared.run([f"plant/parameter[@name='m_c']/@value={mass} kg"])
    ...         print(mass, outcome.passed, outcome.figures[0].range_rms)
    """

    def __init__(self, scenario: Scenario, record: Collection[str] | None = None, *, isolate: bool = True) -> None:
        self.scenario = scenario
        self.resets = True
        self._record = record
        self._isolate = isolate
        self._variations, self._known = Variations(scenario), Known()
        self._structure = structure(self._placed(scenario))
        self._fleet: Fleet | None = None
        self._before: Simulation | None = None  # the last run, if it has reached its end
        self._memory: list[NDArray[Any]] = []
        self._reset = False  # whether the plants of the last run were those of the run before
        with Ending() as cleanup:
            self._setup = set_up(self._placed(scenario), cleanup, {}, None, self._known)
            self._check_record()
            self._unverified = any(robot.source.model is None for robot in driven_robots(self._setup))
            cleanup.callback(self._end_plants)
            self._cleanup = cleanup.pop_all()

    def run(self, variation: Scenario | Iterable[str | Change] = ()) -> RunOutcome:
        """Run the scenario with other values, and judge it.

        Parameters
        ----------
        variation
            The scenario of this run, or changes of the prepared one as for `Scenario.edited`, such as
            ``simulation/@seed=7``.

        Raises
        ------
        InputError
            A change does not apply, a value makes no sense or is refused by an FMU; or the structure differs,
            `OtherStructure`.
        SimulationError
            The machine lacks what the run needs, such as memory: that is no outcome.
        RunInterrupted
            The user pressed Ctrl-C.
        """
        scenario = variation if isinstance(variation, Scenario) else self._variations.edited(variation)
        scenario = self._placed(scenario)
        self._check_structure(scenario)
        with Ending() as cleanup:
            setup = set_up(scenario, cleanup, {}, self._setup, self._known)
            memory = [] if self._keeps or self._unverified else self._memory
            recorder = self._recorder(scenario, setup, memory)
            outcome = self._run(scenario, setup, recorder)
            if self._reset and self._unverified:
                expected = self._recorder(scenario, setup, [])
                self._unverified = False
                self._end_plants()
                anew = self._run(scenario, setup, expected)
                self.resets = outcome.failure == anew.failure and _equal(recorder.arrays(), expected.arrays())
                return anew
            return outcome

    @property
    def setup(self) -> Setup:
        """The set-up of the scenario itself."""
        return self._setup

    def close(self) -> None:
        """End all plants and remove unpacked files."""
        self._cleanup.close()

    # A run -------------------------------------------------------------------------------------------------

    def _run(self, scenario: Scenario, setup: Setup, recorder: Recorder) -> RunOutcome:
        failure: Failure | None = None
        verdicts: tuple[Verdict, ...] = ()
        described = self._keeps or needs_outlines(scenario.expectations)
        make_result = recorded_result if described else only_signals
        before, self._before = self._before, None
        if before is None and self._unverified:  # a reset after a failure says nothing about others
            self._end_plants()
        with Simulation(
            scenario, setup, fleet=self._lend, recorder=recorder, make_result=make_result, before=before
        ) as simulation:
            try:
                result = simulation.run_to_end()
            except SimulationError as error:
                if lack_of(error):  # which says nothing about the scenario
                    raise
                failure, result = error.failure, error.recorded
            if failure is None:
                verdicts = judge(scenario.expectations, result, partial(run_other, setup))
                self._before = simulation
            messages = () if self._fleet is None else tuple(self._fleet.messages)
        return RunOutcome(
            status="completed" if failure is None else "failed",
            verdicts=verdicts,
            figures=follower_figures(scenario.horizon, scenario.step, result),
            failure=failure,
            plant_messages=messages,
            result=self._kept(scenario, setup, result),
        )

    def _recorder(self, scenario: Scenario, setup: Setup, memory: list[NDArray[Any]]) -> Recorder:
        wanted = None if self._unverified else self._wanted(scenario, setup)  # all variables are compared
        return Recorder(scenario.ticks + 1, setup.result_variables, wanted, memory, setup.storage.empty)

    def _wanted(self, scenario: Scenario, setup: Setup) -> set[str] | None:
        """Return the signals of an outcome and those that it follows from; None for all."""
        if self._record == EVERYTHING:
            return None
        return {*needed(scenario.expectations, setup.signals), *NEEDED, *(self._record or ())}

    def _kept(self, scenario: Scenario, setup: Setup, result: Result) -> Result | None:
        """Return what an outcome holds of a result."""
        if not self._keeps or (wanted := self._wanted(scenario, setup)) is None:
            return result if self._keeps else None
        return replace(result, data_vars={name: one for name, one in result.data_vars.items() if name in wanted})

    @property
    def _keeps(self) -> bool:
        """Whether outcomes hold signals, so that each run needs memory of its own."""
        return self._record is not None

    def _lend(
        self,
        robots: Sequence[RobotSetup],
        horizon: float,
        state: Floats,
        columns: Sequence[tuple[int, ...]],
    ) -> AbstractContextManager[AnyFleet]:
        """Put the plants at the start of a run, at whose end they stay."""
        if not self.resets:
            self._end_plants()
        members = members_of(robots, horizon, columns, self._known)
        self._reset = self._fleet is not None
        if self._fleet is None:
            self._fleet = Fleet(members, state, often=True)
        else:
            self._fleet.restart(members, state)
        return nullcontext(self._fleet)

    def _end_plants(self) -> None:
        fleet, self._fleet = self._fleet, None
        if fleet is not None:
            fleet.close()

    # What can be run ---------------------------------------------------------------------------------------

    def _placed(self, scenario: Scenario) -> Scenario:
        """Return the scenario with the processes of its FMUs."""
        return contained(scenario) if self._isolate else scenario

    def _check_record(self) -> None:
        for name in () if self._record in (None, EVERYTHING) else self._record:
            if name not in self._setup.signals:
                raise InputError(f"the run records no signal {name!r}: {nearest(name, list(self._setup.signals))}")

    def _check_structure(self, scenario: Scenario) -> None:
        asked = structure(scenario)
        for what, prepared in self._structure.items():
            if asked.get(what) != prepared:
                raise OtherStructure(
                    f"{scenario.name!r} cannot be run as a variation of {self.scenario.name!r}, as {what} differs: "
                    "prepare it on its own"
                )


def _equal(one: Mapping[str, Floats], other: Mapping[str, Floats]) -> bool:
    return all(np.array_equal(values, other[name], equal_nan=True) for name, values in one.items())
