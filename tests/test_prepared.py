"""Prepared once, run often: each run has the numbers of the same scenario run alone, whatever ran before it."""

import pickle
import re
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lxml import etree

import cosim
from cosim.errors import Failure, InputError, RunInterrupted, SimulationError
from cosim.master.prepared import EVERYTHING, Prepared
from cosim.master.segment import Segment
from cosim.plant.instance import Instance
from cosim.plant.process import PlantProcess
from cosim.results.expectations import judge
from cosim.results.outcome import RunOutcome
from cosim.results.result import Result
from cosim.scenario.scenario import Scenario

from .two_followers import two_followers

HORIZON = 0.6
SCENARIOS = (
    "clmr_circle",
    "clmr_line",
    "differential_drive",
    "formation_change",
    "half_power",
    "heavy_payload",
    "mixed_team",
    "sensor_dropout",
    "side_wind",
    "tractor_trailer_circle",
)
VARIATIONS = 20
"""Of each of these."""
NUMBERS = {
    "parameter": ("value",),
    "gain": ("value",),
    "pose": ("x", "y", "psi", "gamma"),
    "noise": ("x", "y", "psi", "gamma"),
    "saturation": ("limit",),
    "torque": ("tau_drive", "tau_steer"),
    "desired": ("range", "bearing"),
}
"""Attributes that are varied, by element."""
KEPT = ("solver_step", "tolerance")
"""Parameters that are not."""

Make = Callable[..., Path]


def variations(scenario: Scenario, random: np.random.Generator, count: int) -> list[list[str]]:
    """Return changes of a scenario: another seed, and a few of its numbers made larger or smaller by up to a fifth."""
    root = etree.fromstring(scenario.text.encode())
    places = []
    for element in root.iter("{*}*"):
        tag = etree.QName(element).localname
        for name in NUMBERS.get(tag, ()) if element.get("name") not in KEPT else ():
            if found := re.match(r"-?[\d.]+(?:e-?\d+)?", element.get(name, "")):
                path = re.sub(r"\{[^}]*\}", "", root.getroottree().getelementpath(element))
                places.append((f"{path}/@{name}", float(found[0]), element.get(name)[found.end() :]))
    made = []
    for _ in range(count):
        chosen = random.choice(len(places), size=int(random.integers(1, 5)), replace=False)
        changes = [f"simulation/@seed={random.integers(10**6)}"]
        for path, number, unit in (places[index] for index in chosen):
            changes.append(f"{path}={number * random.uniform(0.8, 1.2)!r}{unit}")
        made.append(changes)
    return made


def alone(scenario: Scenario) -> tuple[Result | None, Failure | str | None]:
    """Return the result of a run of its own, and why it did not reach its end, or why there is none."""
    try:
        return Result.of(cosim.run(scenario)), None
    except SimulationError as error:
        return error.recorded, error.failure
    except InputError as error:
        return None, str(error)


def assert_as_alone(prepared: Prepared, variation: Scenario | Sequence[str]) -> RunOutcome | None:
    """Run a variation and check every number of it against a run of its own; None if both refuse it."""
    scenario = variation if isinstance(variation, Scenario) else prepared.scenario.edited(variation)
    expected, failure = alone(scenario)
    if expected is None:
        with pytest.raises(InputError) as refused:
            prepared.run(scenario)
        assert str(refused.value) == failure
        return None
    outcome = prepared.run(scenario)
    assert outcome.failure == failure
    assert outcome.result is not None
    assert outcome.result.data_vars.keys() == expected.data_vars.keys()
    for name, variable in expected.data_vars.items():
        assert np.array_equal(outcome.result[name].values, variable.values, equal_nan=True), name
    if failure is None:
        assert repr(outcome.verdicts) == repr(judge(scenario.expectations, expected, None))
    return outcome


# The same numbers ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SCENARIOS)
def test_variations_have_the_numbers_of_runs_alone(scenarios: Path, name: str) -> None:
    scenario = cosim.read_scenario(scenarios / f"{name}.xml").edited(horizon=HORIZON, expectations=False)
    scenario = scenario.edited([with_expectations])
    random = np.random.default_rng(len(name))
    with Prepared(scenario, EVERYTHING) as prepared:
        outcomes = [assert_as_alone(prepared, changes) for changes in variations(scenario, random, VARIATIONS)]
    assert sum(outcome is not None for outcome in outcomes) > VARIATIONS // 2
    assert len({outcome.figures for outcome in outcomes if outcome is not None}) > VARIATIONS // 2, "nothing varies"


def test_what_stays_where_it_is_is_not_wired_again(scenarios: Path) -> None:
    scenario = cosim.read_scenario(scenarios / "clmr_line.xml").edited(horizon=HORIZON, expectations=False)
    scenario = scenario.edited([with_expectations])
    changes: dict[str, bool] = {  # whether the run before has the same wiring
        "simulation/@seed=2": True,
        "plant/parameter[@name='m_c']/@value=40 kg": True,
        "follower[2]/pose/@y=9 m": True,
        "sensor/noise/@x=2 mm": True,
        "actuator/saturation/@limit=3 N.m": True,
        "//gain[@name='K_p']/@value=12": False,
        "leader/torque/@tau_steer=1 N.m": False,
        "follower[1]/desired/@range=4 m": False,
        "expect/peak/@signal=measured_pose": False,
        "simulation/@seed=3": False,
        "//gain[@name='K_p']/@value=10": True,
    }
    with Prepared(scenario) as prepared:
        prepared.run()
        for change, stays in changes.items():
            assert prepared._before is not None
            before = prepared._before._ticks._wiring
            prepared.run([change])
            ticks = prepared._before._ticks
            assert (ticks._wiring is before) == stays, change
            expected = Result.of(cosim.run(scenario.edited([change])))
            arrays = ticks.recorder.arrays()
            assert len(arrays) > 2
            for name, values in arrays.items():
                assert np.array_equal(values, expected[name].values, equal_nan=True), (change, name)


def with_expectations(root: etree._Element) -> None:
    expect = etree.SubElement(root, "expect")
    etree.SubElement(expect, "rms", signal="range_error", below="1 m", to=f"{HORIZON} s")
    etree.SubElement(expect, "peak", signal="pose", component="x", below="5 m")
    etree.SubElement(expect, "settled", by=f"{HORIZON / 2} s", range="1 m", bearing="20 deg")


@pytest.fixture
def line(scenarios: Path) -> Scenario:
    return cosim.read_scenario(scenarios / "clmr_line.xml").edited(horizon=HORIZON, expectations=False)


FAILING = {
    "diverges": ["//gain[@name='K_p']/@value=1e15", "//saturation/@limit=1e300 N.m"],
    "refuses its input": ["//gain[@name='K_p']/@value=1e308", "//saturation/@limit=1e300 N.m"],
    "is no scenario": ["simulation/@seed=one"],
    "is refused by the FMU": ["//parameter[@name='m_c']/@value=-1 kg"],
    "selects nothing": ["//parameter[@name='m_d']/@value=1 kg"],
}
"""Variations that come to a bad end."""


def test_a_run_that_fails_leaves_the_next_one_as_it_is(line: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also one that is interrupted; in random order."""
    random = np.random.default_rng(1)
    good = ["simulation/@seed=7", "//parameter[@name='m_c']/@value=40 kg"]
    seen = set()
    with Prepared(line, EVERYTHING) as prepared:
        for what in random.permutation([*FAILING, "is interrupted"] * 3):
            if what == "is interrupted":
                with monkeypatch.context() as patch:
                    run = Segment.run
                    patch.setattr(Segment, "run", lambda *of, run=run: signal.raise_signal(signal.SIGINT) or run(*of))
                    with pytest.raises(RunInterrupted):
                        prepared.run()
            else:
                try:
                    outcome = assert_as_alone(prepared, FAILING[what])
                except InputError:
                    outcome = None
                seen.add((what, outcome.status if outcome else "refused"))
            again = assert_as_alone(prepared, good)
            assert again is not None
            assert again.status == "completed"
    assert {status for _, status in seen} == {"failed", "refused"}


def test_only_what_is_needed_is_judged_alike(scenarios: Path) -> None:
    scenario = cosim.read_scenario(scenarios / "clmr_line.xml").edited(
        ["//settled/@by=2 s", "//rms/@from=2 s"], horizon=3.0
    )
    with (
        Prepared(scenario) as little,
        Prepared(scenario, ["torque", "bearing"]) as some,
        Prepared(scenario, EVERYTHING) as everything,
    ):
        for seed in range(1, 4):
            changes = [f"simulation/@seed={seed}"]
            expected, one, other = everything.run(changes), little.run(changes), some.run(changes)
            assert one.figures == other.figures == expected.figures
            assert repr(one.verdicts) == repr(other.verdicts) == repr(expected.verdicts)
            assert one.result is None
            assert other.result is not None
            assert {"torque", "bearing"} <= other.result.data_vars.keys() < expected.result.data_vars.keys()
            assert np.array_equal(other.result["bearing"].values, expected.result["bearing"].values)


def test_an_outcome_is_not_overwritten(line: Scenario) -> None:
    with Prepared(line, ["pose"]) as prepared:
        first = prepared.run().result["pose"].values
        kept = first.copy()
        prepared.run(["simulation/@seed=9", "//parameter[@name='m_c']/@value=90 kg"])
    assert np.array_equal(first, kept)


def digest(outcome: RunOutcome) -> tuple[Any, ...]:
    return outcome.status, repr(outcome.figures), outcome.result["torque"].values.tobytes()


def runs(path: Path, seeds: Sequence[int]) -> list[tuple[Any, ...]]:
    scenario = cosim.read_scenario(path).edited(horizon=HORIZON, expectations=False)
    with Prepared(scenario, ["torque"]) as prepared:
        return [digest(prepared.run([f"simulation/@seed={seed}"])) for seed in seeds]


def test_threads_and_processes_have_the_same_numbers(scenarios: Path) -> None:
    path = scenarios / "clmr_line.xml"
    expected = runs(path, range(8))
    with ThreadPoolExecutor(2) as threads:
        found = list(threads.map(runs, [path, path], [range(4), range(4, 8)]))
    assert [*found[0], *found[1]] == expected
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as processes:
        found = list(processes.map(runs, [path, path], [range(7, 3, -1), range(3, -1, -1)]))
    assert [*reversed(found[1]), *reversed(found[0])] == expected


def test_an_outcome_can_be_pickled(line: Scenario) -> None:
    with Prepared(line, ["torque"]) as prepared:
        for changes in ([], FAILING["diverges"]):
            outcome = prepared.run(changes)
            copy = pickle.loads(pickle.dumps(outcome))
            assert digest(copy) == digest(outcome)
            assert (copy.message, copy.passed) == (outcome.message, outcome.passed)
    assert "has diverged" in outcome.message
    assert not outcome.passed


# Other tools' FMUs -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("interface", ["co_simulation", "model_exchange"])
@pytest.mark.parametrize("fmi", ["1.0", "2.0", "3.0"])
@pytest.mark.parametrize("behaviour", ["good", "stale", "error", "fatal_strict"])
def test_fmus_of_others(
    make: Make, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, fmi: str, interface: str, behaviour: str
) -> None:
    """An FMU that is not reset as it should be is started anew for every run, as is one that refuses."""
    fmu = make(name="stub", fmi=fmi, interface=interface, behaviour=behaviour, place="reset")
    path = tmp_path / "two.xml"
    path.write_text(two_followers(f'<plant id="car" fmu="{fmu}"/>', horizon="0.5 s"))
    scenario = cosim.read_scenario(path)
    started = []
    start = Instance.__init__
    monkeypatch.setattr(Instance, "__init__", lambda self, spec: started.append(spec) or start(self, spec))
    with Prepared(scenario, EVERYTHING, isolate=False) as prepared:
        counts = []
        for torque in (3.0, 20.0, -4.0, 3.0):
            assert_as_alone(prepared, [f"leader/torque/@tau_drive={torque} N.m"])
            counts.append(len(started))
        outcome = prepared.run()
    anew = [second - first for first, second in pairwise(counts)]
    can_reset = fmi != "1.0" or interface == "co_simulation"
    assert prepared.resets == (behaviour != "stale" or not can_reset)
    assert anew[-1] == (0 if behaviour == "good" and can_reset else 3)
    assert outcome.status == "completed"


@pytest.mark.parametrize("behaviour", ["good", "stale"])
def test_resets_are_compared_in_all_variables(make: Make, tmp_path: Path, behaviour: str) -> None:
    """Whatever outcomes hold; and all of them hold the same signals."""
    fmu = make(name="stub", fmi="2.0", interface="co_simulation", behaviour=behaviour, place="reset")
    path = tmp_path / "two.xml"
    path.write_text(two_followers(f'<plant id="car" fmu="{fmu}"/>', horizon="0.1 s"))
    with Prepared(cosim.read_scenario(path), ["torque"]) as prepared:
        outcomes = [prepared.run([f"leader/torque/@tau_drive={torque} N.m"]) for torque in (3, 20, 4)]
        assert prepared.resets == (behaviour == "good")
    held = [outcome.result.data_vars.keys() for outcome in outcomes]
    assert held[0] == held[1] == held[2]
    assert "velocity" not in held[0]


# What can be run -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ("simulation/@horizon=2 s", "the horizon"),
        ("simulation/@step=10 ms", "the step"),
        ("follower[1]/@id=another", "the list of followers"),
        ("plant/@model=differential_drive", "the plant 'clmr'"),
    ],
)
def test_another_structure_is_refused(line: Scenario, change: str, what: str) -> None:
    with Prepared(line) as prepared:
        with pytest.raises(InputError, match=f"'clmr_line' cannot be run .* as {what} differs: prepare it on its own"):
            prepared.run([change])
        assert prepared.run().status == "completed"


def test_a_signal_that_is_not_there(line: Scenario) -> None:
    with pytest.raises(InputError, match="the run records no signal 'torqe': did you mean 'torque'"):
        Prepared(line, ["torqe"])


# Isolation -------------------------------------------------------------------------------------------------------


def stubs(make: Make, folder: Path, isolate: str = "", horizon: str = "0.5 s", **options: Any) -> Scenario:
    """Return a scenario of two followers and their leader, all of them a stub."""
    path = folder / "two.xml"
    plant = f'<plant id="car" fmu="{make(name="stub", **options)}" time_limit="10 s" {isolate}/>'
    path.write_text(two_followers(plant, horizon=horizon), encoding="utf-8")
    return cosim.read_scenario(path)


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[PlantProcess]:
    """Return the processes of plants, to which each that starts is added."""
    found: list[PlantProcess] = []
    start = PlantProcess.__init__
    monkeypatch.setattr(PlantProcess, "__init__", lambda self, *more: found.append(self) or start(self, *more))
    return found


def test_a_process_goes_on_from_run_to_run(make: Make, tmp_path: Path, started: list[PlantProcess]) -> None:
    """Unless it resets its FMUs wrongly, of which the second one tells: the numbers are those of runs alone."""
    for behaviour, processes in (("good", [1, 2, 2]), ("stale", [1, 2])):
        scenario = stubs(make, tmp_path, behaviour=behaviour, place="reset")
        started.clear()
        with Prepared(scenario, EVERYTHING) as prepared:
            counts = []
            for torque in (3.0, 20.0, -4.0)[: len(processes)]:
                assert_as_alone(prepared, [f"leader/torque/@tau_drive={torque} N.m"])
                counts.append(len(started))
            assert prepared.resets == (behaviour == "good")
        assert counts == processes


def test_an_fmu_ends_its_run_alone(make: Make, tmp_path: Path, started: list[PlantProcess]) -> None:
    """What it does at 0.2 s, in the process of a user's program that steps or prepares a scenario by itself."""
    scenario = stubs(make, tmp_path, behaviour="exit_0", when=0.2)
    with cosim.Simulation(scenario) as simulation, pytest.raises(SimulationError) as caught:
        simulation.run()
    assert caught.value.time == 0.2
    assert simulation.tick == 10
    assert caught.value.result.sizes["time"] == 11
    with Prepared(scenario) as prepared:
        for seed in (1, 2):
            outcome = prepared.run([f"simulation/@seed={seed}"])
            assert (outcome.failure.robot, outcome.failure.time) == ("leader", 0.2)
            assert "its process" in outcome.message
    assert len(started) == 3
    assert all(process._process.returncode is not None for process in started)


def test_an_fmu_that_is_trusted_runs_in_the_process_of_the_caller(
    make: Make, tmp_path: Path, started: list[PlantProcess]
) -> None:
    with Prepared(stubs(make, tmp_path, horizon="0.1 s"), isolate=False) as prepared:
        assert prepared.run().status == "completed"
    trusted = stubs(make, tmp_path, 'isolate="no"', horizon="0.1 s")
    with cosim.Simulation(trusted) as simulation, Prepared(trusted) as prepared:
        simulation.run()
        prepared.run()
    assert not started
