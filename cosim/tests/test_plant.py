"""Plants of every version of FMI: each moves by the equations of the stub, or is refused with the reason."""

import ctypes
import json
import math
import os
import re
import subprocess
import sys
import threading
import zipfile
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import fmpy.fmi1
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import cosim
import plants
from cosim.compiled import COMPILED, compiled
from cosim.errors import InputError, SimulationError
from cosim.fmu.vehicle import open_fmu
from cosim.master.robot_plants import in_own_process
from cosim.master.simulation import Simulation
from cosim.plant.calls import c_function
from cosim.plant.log import Log
from cosim.plant.spec import Block, Exchanged, PlantSpec, Value
from cosim.plant.working_folder import returning
from cosim.scenario.grammar import NAMESPACE
from cosim.scenario.reader import read_binding, read_scenario
from cosim.scenario.scenario import BindingSource

from .driving import STEP, drive, fleet, scenario

FMI = ("1.0", "2.0", "3.0")
TIME = STEP * np.arange(100)
TORQUES = np.column_stack([5.0 + 10.0 * np.sin(TIME), 3.0 * np.cos(2.0 * TIME)])
POSE = (1.0, -2.0, 0.3, 0.2)
MODEL = {"interface": "model_exchange"}

Make = Callable[..., Path]
Floats = NDArray[np.float64]


class Names(dict[str, str]):
    """Other names of variables, which distinguish one stub from another."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(tuple(self.items()))


def declared(path: Path, roles: str) -> BindingSource:
    path.write_text(f'<binding xmlns="{NAMESPACE}" vehicle="car_like">{roles}</binding>', encoding="utf-8")
    return read_binding(path)


@pytest.fixture
def arrays(tmp_path: Path) -> BindingSource:
    """Return a binding for the stubs that have arrays."""
    units = {"x": "m", "y": "m", "psi": "rad", "gamma": "rad"}
    pose = [
        f'<role name="{name}" variable="pose[{i}]" unit="{unit}"/>' for i, (name, unit) in enumerate(units.items(), 1)
    ]
    torque = [f'<role name="{name}" variable="torque[{i}]"/>' for i, name in enumerate(("tau_drive", "tau_steer"), 1)]
    return declared(tmp_path / "arrays.xml", "".join(pose + torque))


def rates(z: Any, torque: Any) -> list[float]:
    """Return the derivatives of the stub's states."""
    return [
        z[4] * math.cos(z[2]),
        z[4] * math.sin(z[2]),
        z[4] * math.tan(z[3]) / 1.2,
        z[5],
        torque[0] / 10.0,
        torque[1] / 10.0,
    ]


def exact(torques: Floats, pose: tuple[float, ...] = POSE, step: float = STEP) -> Floats:
    """Return the states (n + 1, 6), integrated to rounding with the torques held over each step."""
    z = np.array([*pose, 0.0, 0.0])
    out = [z]
    for torque in torques:
        solution = solve_ivp(
            lambda _, z, u=torque: rates(z, u), (0.0, step), z, method="DOP853", rtol=1e-13, atol=1e-14
        )
        z = solution.y[:, -1]
        out.append(z)
    return np.array(out)


# Every kind moves alike -------------------------------------------------------------------------------------

KINDS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    **{f"fmi{fmi[0]}_cs": ({"fmi": fmi}, {}) for fmi in FMI},
    **{f"fmi{fmi[0]}_me": ({"fmi": fmi, **MODEL}, {"solver": "euler"}) for fmi in FMI},
    **{f"fmi{fmi[0]}_me_of_both": ({"fmi": fmi, "interface": "both"}, MODEL | {"solver": "euler"}) for fmi in FMI[1:]},
    "arrays_cs": ({"fmi": "3.0", "arrays": True}, {}),
    "arrays_me": ({"fmi": "3.0", "arrays": True, **MODEL}, {"solver": "euler"}),
    "once": ({"fmi": "2.0", "once": True}, {}),
    "with_state": ({"fmi": "3.0", "save": True}, {}),
    "execution_tool": ({"fmi": "2.0", "execution_tool": True}, {}),
    "feed_through": ({"fmi": "2.0", "feedthrough": True}, {}),
    "fixed_step": ({"fmi": "3.0", "fixed_step": 0.02}, {}),
    "event_mode": ({"fmi": "3.0", "event_mode": True, "when": 1e9}, {}),
    "may_return_early": ({"fmi": "3.0", "early_return": "allowed"}, {}),
}


@pytest.fixture(scope="module")
def reference(make: Make) -> Floats:
    return drive(make(fmi="2.0"), TORQUES, pose=POSE)


def test_the_reference_is_euler_s_method(reference: Floats) -> None:
    z = [*POSE, 0.0, 0.0]
    for torque, found in zip(TORQUES, reference[1:], strict=True):
        z = [a + STEP * b for a, b in zip(z, rates(z, torque), strict=True)]
        assert found == pytest.approx(z, abs=1e-13)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("isolated", [False, True], ids=["in_process", "isolated"])
def test_every_kind_moves_alike_to_the_bit(
    make: Make, reference: Floats, arrays: BindingSource, kind: str, isolated: bool
) -> None:
    options, use = KINDS[kind]
    binding = arrays if options.get("arrays") else None
    moved = drive(make(**options), TORQUES, pose=POSE, binding=binding, isolated=isolated, **use)
    np.testing.assert_array_equal(moved, reference)


def test_tick_by_tick_is_as_at_once(make: Make, reference: Floats) -> None:
    for options in ({"fmi": "2.0"}, {"fmi": "3.0", **MODEL}):
        with fleet(make(**options), pose=POSE, solver="euler") as (started, state):
            for tick, torque in enumerate(TORQUES):
                np.testing.assert_array_equal(state[0], reference[tick])
                started.step(tick, STEP, torque)
            np.testing.assert_array_equal(state[0], reference[-1])


def test_many_kinds_in_one_fleet(make: Make, reference: Floats) -> None:
    """Of all versions and interfaces, in this process and in others."""
    fmus = [
        make(**options)
        for options in ({"fmi": "1.0", **MODEL}, {"fmi": "2.0"}, {"fmi": "3.0", **MODEL}, {"fmi": "3.0"})
    ] * 2
    isolated = [True, False] * 3 + [False, True]
    with fleet(*fmus, pose=POSE, solver="euler", isolated=isolated) as (started, state):
        for tick, torque in enumerate(TORQUES):
            started.step(tick, STEP, np.tile(torque, len(fmus)))
        for row in state:
            np.testing.assert_array_equal(row, reference[-1])


@pytest.mark.parametrize("fmi", FMI)
def test_units_and_initial_values(make: Make, reference: Floats, tmp_path: Path, fmi: str) -> None:
    roles = "".join(f'<role name="{name}" variable="{name}" initial="{name}0"/>' for name in ("x", "y", "psi", "gamma"))
    fmu = make(fmi=fmi, units="deg", initial="parameters")
    moved = drive(fmu, TORQUES, pose=POSE, binding=declared(tmp_path / "b.xml", roles))
    np.testing.assert_allclose(moved, reference, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("isolated", [False, True], ids=["in_process", "isolated"])
def test_a_pose_that_is_not_taken_is_refused(make: Make, tmp_path: Path, isolated: bool) -> None:
    roles = '<role name="x" variable="x" initial="y0"/><role name="y" variable="y" initial="x0"/>'
    roles += "".join(f'<role name="{name}" variable="{name}" initial="{name}0"/>' for name in ("psi", "gamma"))
    binding = declared(tmp_path / "b.xml", roles)
    sentence = "the FMU stub.fmu does not take the initial pose of robot_1: x is -2 m at the start, not 1 m"
    with (
        pytest.raises(InputError, match=sentence),
        fleet(make(initial="parameters"), pose=POSE, binding=binding, isolated=isolated),
    ):
        pass


def test_angles_may_be_turned_by_whole_turns(make: Make) -> None:
    with fleet(make(step_event=True), pose=(0.0, 0.0, 7.0, 0.0)) as (started, state):
        started.step(0, STEP, np.zeros(2))
        assert state[0, 2] == pytest.approx(7.0 - math.tau)


def test_velocities_that_are_not_offered_are_no_numbers(make: Make, reference: Floats) -> None:
    moved = drive(make(velocities=False), TORQUES, pose=POSE)
    np.testing.assert_array_equal(moved[:, :4], reference[:, :4])
    assert np.isnan(moved[:, 4:]).all()


# Model Exchange ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fmi", FMI)
@pytest.mark.parametrize(("solver", "order"), [("euler", 1), ("runge_kutta_4", 4)])
def test_order_of_convergence(make: Make, fmi: str, solver: str, order: int) -> None:
    """The error falls with the order of the method as the solver's step is halved, against an exact solution."""
    torques, step = TORQUES[:20], 0.1  # gentle enough for the steering to stay away from a right angle
    solution = exact(torques, step=step)
    errors = [
        np.abs(drive(make(fmi=fmi, **MODEL), torques, step, pose=POSE, solver=solver, solver_steps=n) - solution).max()
        for n in (1, 2, 4)
    ]
    for coarse, fine in pairwise(errors):
        assert math.log2(coarse / fine) == pytest.approx(order, abs=0.25)


def test_the_default_is_runge_kutta_with_the_communication_step(make: Make) -> None:
    fmu = make(fmi="3.0", **MODEL)
    expected = drive(fmu, TORQUES, solver="runge_kutta_4", solver_steps=1)
    np.testing.assert_array_equal(drive(fmu, TORQUES), expected)


@pytest.mark.parametrize("fmi", FMI)
@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
def test_cvode_keeps_its_tolerance(make: Make, fmi: str, tolerance: float) -> None:
    """Over 20 steps of 0.5 s, in each of which it starts anew, errors add up to some hundred times the tolerance."""
    torques, step = TORQUES[:20] * [1.0, 0.03], 0.5
    fmu = make(fmi=fmi, **MODEL)
    moved = drive(fmu, torques, step, pose=POSE, solver="cvode", tolerance=tolerance)
    error = (np.abs(moved - exact(torques, step=step)) / (1.0 + np.abs(moved))).max()
    assert 0.01 * tolerance < error < 300 * tolerance


@pytest.mark.parametrize("isolated", [False, True], ids=["in_process", "isolated"])
def test_cvode_in_a_process_of_its_own_is_the_same(make: Make, isolated: bool) -> None:
    fmu = make(fmi="2.0", **MODEL)
    expected = drive(fmu, TORQUES[:20], solver="cvode")
    np.testing.assert_array_equal(drive(fmu, TORQUES[:20], solver="cvode", isolated=isolated), expected)


# Events -----------------------------------------------------------------------------------------------------


@pytest.mark.skipif(sys.platform != "linux", reason="counts open files as Linux does")
def test_cvode_leaves_no_file_open(make: Make) -> None:
    fmu = make(fmi="2.0", **MODEL)
    drive(fmu, TORQUES[:2], solver="cvode")
    before = len(os.listdir("/proc/self/fd"))
    drive(fmu, TORQUES[:2], solver="cvode")
    assert len(os.listdir("/proc/self/fd")) == before


SOLVERS = ("euler", "runge_kutta_4", "cvode")


@pytest.mark.parametrize("fmi", FMI)
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("when", [1.0, 1.013, 0.02, 1e-12, 0.14, 0.2, 7 * STEP])
def test_a_time_event_is_hit(make: Make, fmi: str, solver: str, when: float) -> None:
    """It brakes to standstill, from which it accelerates again; the speed is linear, so that each method is exact."""
    fmu = make(fmi=fmi, time_event=True, when=when, **MODEL)
    moved = drive(fmu, np.tile([10.0, 0.0], (100, 1)), solver=solver, tolerance=1e-10)
    time = STEP * np.arange(101)
    speed = np.where(time < when - 1e-10, time, time - when)
    np.testing.assert_allclose(moved[:, 4], speed, rtol=0.0, atol=1e-8 if solver == "cvode" else 2e-12)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_time_event_is_hit_late_in_a_long_run_with_small_parts(make: Make, solver: str) -> None:
    """There a time is rounded more coarsely than a thousand millionth of a part."""
    step, first = 0.001, 600_002
    fmu = make(fmi="2.0", time_event=True, when=first * step, **MODEL)
    options = {"tolerance": 1e-10} if solver == "cvode" else {"solver_steps": 10}
    speeds = []
    with fleet(fmu, solver=solver, horizon=1e7, **options) as (started, state):
        for tick in range(first - 3, first + 2):
            started.step(tick, step, np.array([10.0, 0.0]))
            speeds.append(float(state[0, 4]))
    assert speeds == pytest.approx([0.001, 0.002, 0.0, 0.001, 0.002], abs=1e-6)


def pressed_to_the_stop(time: Floats, limit: float) -> Floats:
    """Return the steering angle that rises with 0.5 t^2 to a stop, is held there for 1 s, and comes back as it went."""
    reached = math.sqrt(2.0 * limit)
    back = np.maximum(limit - 0.5 * np.maximum(time - 2.0, 0.0) ** 2, -limit)
    return np.where(time < reached, 0.5 * time**2, np.where(time < 2.0, limit, back))


@pytest.mark.parametrize("fmi", FMI)
@pytest.mark.parametrize("solver", SOLVERS)
def test_state_events_and_inputs_that_jump(make: Make, fmi: str, solver: str) -> None:
    """The steering meets a stop, is held, is released by a torque that changes its sign, and meets the other stop."""
    torques = np.zeros((250, 2))
    torques[:100, 1], torques[100:, 1] = 10.0, -10.0
    moved = drive(make(fmi=fmi, end_stop=0.5, **MODEL), torques, solver=solver, tolerance=1e-10)
    time = STEP * np.arange(251)
    off = np.abs(moved[:, 3] - pressed_to_the_stop(time, 0.5))
    if solver == "cvode":
        assert off.max() < 1e-6, "it finds when a stop is met"
    else:
        assert off.max() < 1.5 * STEP, "a stop is met within a step, at a speed of about 1 rad/s"
    held = (time > 1.03) & (time < 2.0)
    assert (moved[held, 3] == 0.5).all()
    assert (moved[held, 5] == 0.0).all()
    assert moved[time > 3.6, 3] == pytest.approx(-0.5, abs=1e-12)


@pytest.mark.parametrize("fmi", FMI[1:])
@pytest.mark.parametrize("solver", SOLVERS)
def test_discrete_inputs_are_set_in_event_mode_alone(make: Make, fmi: str, solver: str) -> None:
    torques = np.repeat([[10.0, 1.0], [0.0, 0.0], [-5.0, -1.0]], 4, axis=0)
    moved, expected = (drive(make(fmi=fmi, jumps=jumps, **MODEL), torques, solver=solver) for jumps in (True, False))
    np.testing.assert_array_equal(moved, expected)


@pytest.mark.parametrize("fmi", FMI)
@pytest.mark.parametrize("solver", SOLVERS)
def test_a_step_event(make: Make, fmi: str, solver: str) -> None:
    """After a step that has turned it by more than half a turn, the heading is brought back by a whole one."""
    torques = np.tile([10.0, 0.0], (200, 1))
    pose = (0.0, 0.0, 0.0, 0.8)
    moved = drive(make(fmi=fmi, step_event=True, **MODEL), torques, pose=pose, solver=solver, tolerance=1e-10)
    plain = drive(make(fmi=fmi, **MODEL), torques, pose=pose, solver=solver, tolerance=1e-10)
    assert np.abs(plain[:, 2]).max() > math.pi
    assert np.abs(moved[:, 2]).max() <= math.pi
    turns = (plain[:, 2] - moved[:, 2]) / math.tau
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-6)
    assert turns.max() == pytest.approx(1.0)


@pytest.mark.parametrize("fmi", FMI)
def test_events_in_a_process_of_its_own(make: Make, fmi: str) -> None:
    torques = np.zeros((150, 2))
    torques[:100, 1], torques[100:, 1] = 10.0, -10.0
    fmu = make(fmi=fmi, end_stop=0.5, time_event=True, step_event=True, **MODEL)
    for solver in SOLVERS:
        alone, inside = (drive(fmu, torques, solver=solver, isolated=isolated) for isolated in (True, False))
        np.testing.assert_array_equal(alone, inside)


@pytest.mark.parametrize("fmi", FMI)
def test_events_within_a_step_of_co_simulation(make: Make, fmi: str) -> None:
    moved = drive(make(fmi=fmi, time_event=True, when=1.013), np.tile([10.0, 0.0], (100, 1)))
    assert moved[-1, 4] == pytest.approx(2.0 - 1.013, abs=1e-12)


# What FMI 3.0 Co-Simulation may offer -----------------------------------------------------------------------


def test_event_mode_that_is_not_used(make: Make) -> None:
    """The FMU gets this setting and handles its events itself."""
    torques = np.tile([10.0, 0.0], (100, 1))
    for early in ("", "allowed"):
        moved = drive(make(fmi="3.0", event_mode=True, early_return=early, when=1.013), torques)
        assert moved[-1, 4] == pytest.approx(2.0 - 1.013, abs=1e-12)


def test_what_returns_early_though_it_must_not_is_asked_for_the_rest(make: Make) -> None:
    """It does so at half of a step: Euler's method with half the step."""
    moved = drive(make(fmi="3.0", early_return="always"), TORQUES, pose=POSE)
    halves = drive(make(fmi="2.0"), np.repeat(TORQUES, 2, axis=0), STEP / 2, pose=POSE)[::2]
    np.testing.assert_allclose(moved, halves, rtol=0.0, atol=1e-12)


def test_intermediate_updates_are_not_asked_for(make: Make, reference: Floats) -> None:
    moved = drive(make(fmi="3.0", intermediate_update=True, early_return="allowed"), TORQUES, pose=POSE)
    np.testing.assert_array_equal(moved, reference)


@pytest.mark.parametrize("fmi", FMI)
def test_a_fixed_internal_step_that_divides(make: Make, fmi: str) -> None:
    moved = drive(make(fmi=fmi, fixed_step=0.005), TORQUES, pose=POSE)
    quarters = drive(make(fmi="2.0"), np.repeat(TORQUES, 4, axis=0), STEP / 4, pose=POSE)[::4]
    np.testing.assert_allclose(moved, quarters, rtol=0.0, atol=1e-12)


def test_a_fixed_internal_step_that_does_not_divide_is_refused(make: Make, tmp_path: Path) -> None:
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{make(fmi="3.0", fixed_step=0.03)}"/>')
    with pytest.raises(InputError) as caught:
        Simulation(read_scenario(path))
    assert "has a fixed internal step of 0.03 s, which does not divide the communication step" in str(caught.value)
    assert caught.value.where is not None
    assert caught.value.where.line == 4


@pytest.mark.parametrize("step", ["0", "-1", "NaN", "INF"])
def test_a_fixed_internal_step_that_is_none_is_refused(make: Make, tmp_path: Path, step: str) -> None:
    stated = 'fixedInternalStepSize="{}"'.format
    fmu = rewritten(make(fmi="3.0", fixed_step=0.02), tmp_path / "a.fmu", stated("0.02"), stated(step))
    with pytest.raises(InputError, match="has a fixed internal step of"):
        Simulation(read_scenario(scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{fmu}"/>')))


def rewritten(source: Path, target: Path, old: str, new: str) -> Path:
    """Copy an FMU with a replacement in its model description."""
    with zipfile.ZipFile(source) as original, zipfile.ZipFile(target, "w") as copy:
        for entry in original.infolist():
            data = original.read(entry)
            if entry.filename == "modelDescription.xml":
                assert old.encode() in data
                data = data.replace(old.encode(), new.encode())
            copy.writestr(entry.filename, data)
    return target


@pytest.mark.parametrize("fmi", FMI[:2])
def test_a_fixed_internal_step_that_is_not_announced_is_found_out(make: Make, fmi: str) -> None:
    with pytest.raises(SimulationError) as caught:
        drive(make(fmi=fmi, fixed_step=0.03), TORQUES)
    assert "did not complete the step (status Error): the step size 0.02 s is no multiple of the fixed" in str(
        caught.value
    )


# In a scenario ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fmi", FMI)
def test_what_can_be_there_only_once_gets_processes(make: Make, tmp_path: Path, fmi: str) -> None:
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{make(fmi=fmi, once=True)}"/>', followers=["car"] * 2)
    with Simulation(read_scenario(path)) as simulation:
        robots = (simulation.setup.leader, *simulation.setup.followers)
        assert all(in_own_process(robot.fmu, robot.source) for robot in robots)
        once = simulation.run()
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{make(fmi=fmi)}"/>', followers=["car"] * 2)
    several = cosim.run(path)
    file = "plant_sha256"  # in which the two differ, and in attributes
    assert once.drop_vars(file).identical(several.drop_vars(file).assign_attrs(once.attrs))


def test_a_second_one_in_a_process_is_refused(make: Make) -> None:
    with (
        pytest.raises(InputError, match="cannot be started as robot_2: it can be instantiated only once per process"),
        fleet(*[make(once=True)] * 2),
    ):
        pass


def test_a_negated_alias_of_fmi_1_is_refused(make: Make, tmp_path: Path) -> None:
    """FMPy does not read the attribute: the sign would be wrong without a word."""
    fmu = make(fmi="1.0")
    old = ' name="psi" '
    negated = rewritten(fmu, tmp_path / "n.fmu", old, f'{old}alias="negatedAlias" ')
    with pytest.raises(InputError, match="has 'psi' as a negated alias, whose sign would be lost"):
        open_fmu(negated)
    alias = rewritten(fmu, tmp_path / "a.fmu", old, f'{old}alias="alias" ')
    open_fmu(alias).close()


def test_a_leader_without_velocities_is_refused(make: Make, tmp_path: Path) -> None:
    plants_ = f'<plant id="car" fmu="{make()}"/><plant id="blind" fmu="{make(velocities=False)}"/>'
    path = scenario(tmp_path / "s.xml", plants_, leader="blind")
    with pytest.raises(
        InputError, match="offers no v and no omega, but its followers need the leader's velocities: give leader"
    ):
        Simulation(read_scenario(path))


def test_followers_without_velocities(make: Make, tmp_path: Path) -> None:
    plants_ = f'<plant id="car" fmu="{make()}"/><plant id="blind" fmu="{make(velocities=False)}"/>'
    seen, blind = (cosim.run(scenario(tmp_path / "s.xml", plants_, followers=[plant])) for plant in ("car", "blind"))
    np.testing.assert_array_equal(seen.pose, blind.pose)
    assert np.isnan(blind.velocity).all()
    path = scenario(tmp_path / "s.xml", plants_, followers=["blind"], law="feedback-linearisation")
    with pytest.raises(InputError, match="needs the velocities of its robots: give follower_1 another plant"):
        Simulation(read_scenario(path))


@pytest.mark.parametrize(
    ("said", "names"),
    [
        ('solver="cvode"', "remove solver"),
        ('solver_step="20 ms"', "remove solver_step"),
        ('solver="euler" solver_step="5 ms"', "remove solver and solver_step"),
    ],
)
def test_a_solver_for_what_brings_its_own_is_refused(make: Make, tmp_path: Path, said: str, names: str) -> None:
    more = '; or state interface="model_exchange", whose solver takes it'
    for fmu, end in ((make(), names), (make(interface="both"), names + more)):
        path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{fmu}" {said}/>')
        with pytest.raises(InputError, match=f"runs in Co-Simulation with a solver of its own: .*{re.escape(end)}$"):
            Simulation(read_scenario(path))


@pytest.mark.parametrize("solver", ["", 'solver="euler" '])
def test_a_tolerance_of_fixed_steps_is_refused(make: Make, tmp_path: Path, solver: str) -> None:
    fmu = make(interface="model_exchange")
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{fmu}" {solver}tolerance="1e-6"/>')
    name = "euler" if solver else "runge_kutta_4"
    with pytest.raises(InputError, match=rf"s.xml:4:\d+: {name} makes steps of constant length and has no tolerance: "):
        Simulation(read_scenario(path))


def test_a_time_limit_may_be_there_for_nothing(make: Make, tmp_path: Path) -> None:
    """Whether the plant is isolated may depend on --untrusted."""
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{make()}" isolate="no" time_limit="5 s"/>')
    result = cosim.run(path)
    assert json.loads(result.attrs["plants"])["car"]["process"] == "the harness"


def test_what_needs_a_tool_says_so_where_it_cannot_be_started(make: Make, tmp_path: Path) -> None:
    fmu = make(execution_tool=True, behaviour="error", place="instantiate")
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{fmu}"/>')
    with pytest.raises(
        InputError, match="as it was made to; it also needs the tool that made it, which may be missing"
    ):
        Simulation(read_scenario(path))


def test_a_parameter_that_follows_from_the_pose_cannot_be_set(make: Make, tmp_path: Path) -> None:
    roles = "".join(f'<role name="{name}" variable="{name}" initial="{name}0"/>' for name in ("x", "y", "psi", "gamma"))
    binding = f'<binding vehicle="car_like">{roles}</binding><parameter name="y0" value="1 m"/>'
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{make(initial="parameters")}">{binding}</plant>')
    with pytest.raises(InputError, match=r"'y0' of stub\.fmu follows from the <pose>: by the binding it gives"):
        Simulation(read_scenario(path))


def test_an_input_that_plays_a_role_is_named_by_the_role(make: Make, tmp_path: Path) -> None:
    binding = '<binding vehicle="car_like"><role name="tau_drive" variable="torque"/></binding>'
    plant = f'<plant id="car" fmu="{make(names=Names(tau_drive="torque"))}">{binding}</plant>'
    for name in ("torque", "tau_drive"):
        text = scenario(tmp_path / "s.xml", plant).read_text("utf-8")
        added = f'<input name="{name}"><constant value="1 N.m"/></input>'
        path = tmp_path / f"{name}.xml"
        path.write_text(text.replace("  <leader", f"  {added}\n  <leader"), "utf-8")
        if name == "torque":
            with pytest.raises(InputError, match=r"'torque' of stub\.fmu plays the role 'tau_drive': write that name"):
                Simulation(read_scenario(path))
        else:
            Simulation(read_scenario(path)).close()


@pytest.mark.parametrize("fmi", FMI)
def test_a_parameter_by_another_name_is_the_same_parameter(make: Make, tmp_path: Path, fmi: str) -> None:
    """An alias of the wheelbase sets it for plant and harness; a follower's value takes its plant's place."""
    fmu = make(fmi=fmi, aliases=Names(wheelbase="a"))
    own = '<desired range="2 m" bearing="0 deg"/>'
    for name in ("a", "wheelbase"):
        plant = f'<plant id="car" fmu="{fmu}"><parameter name="{name}" value="2.4 m"/></plant>'
        path = scenario(tmp_path / f"{name}.xml", plant)
        text = path.read_text("utf-8")
        assert own in text
        path.write_text(text.replace(own, f'{own}<parameter name="wheelbase" value="3 m"/>'), "utf-8")
    by_name, by_alias = (cosim.run(tmp_path / f"{name}.xml") for name in ("a", "wheelbase"))
    assert by_alias["vehicle_wheelbase"].values.tolist() == [2.4, 3.0]
    assert by_alias.drop_attrs().identical(by_name.drop_attrs())


@pytest.mark.parametrize("fmi", FMI)
@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (
            '<parameter name="a" value="1 m"/><parameter name="wheelbase" value="1 m"/>',
            "'wheelbase' of stub.fmu is 'a' by another name, and 'a' has a value in line",
        ),
        ('<parameter name="motor" value="1 N.m"/>', "the FMU stub.fmu has no parameter 'motor'"),
        ('<input name="motor"><constant value="0"/></input>', "'motor' of stub.fmu plays the role 'tau_drive'"),
        (
            '<input name="push" value="1 N"/><input name="shove" value="1 N"/>',
            "the input 'shove' of stub.fmu is 'push' by another name, and 'push' has a value in line",
        ),
        (
            '<input name="gear" value="2"/><input name="ratio" value="2"/>',
            "the input 'ratio' of stub.fmu is 'gear' by another name, and 'gear' has a value in line",
        ),
        (
            '<parameter name="shove" value="1 N"/><input name="push" value="1 N"/>',
            "the input 'shove' is given a value as <parameter> and as <input> 'push': remove one",
        ),
    ],
)
def test_two_names_of_one_variable_are_refused(make: Make, tmp_path: Path, fmi: str, given: str, sentence: str) -> None:
    others = Names(wheelbase="a", motor="tau_drive", shove="push", ratio="gear")
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{make(fmi=fmi, discrete=True, aliases=others)}"/>')
    text = path.read_text("utf-8")
    torque = '<torque tau_drive="2 N.m" tau_steer="0 N.m"/>'
    assert torque in text
    path.write_text(text.replace(torque, torque + given), "utf-8")
    with pytest.raises(InputError, match=re.escape(sentence)) as caught:
        Simulation(read_scenario(path))
    assert re.match(r".*s\.xml:\d+:\d+$", str(caught.value.where))


@pytest.mark.parametrize(
    ("role", "sentence"),
    [
        (
            '<role name="a" variable="push" unit="m" offset="1.2 m"/>',
            "'push' of stub.fmu plays the role 'a' of the geometry, which has one value for the whole run",
        ),
        (
            '<role name="x" variable="x" initial="push" unit="m"/>',
            "the input 'push' of stub.fmu follows from the <pose>: by the binding it gives the initial 'x'",
        ),
    ],
)
def test_an_input_that_gives_the_geometry_or_the_pose_takes_no_signals(
    make: Make, tmp_path: Path, role: str, sentence: str
) -> None:
    fmu = make(discrete=True, units="names")
    plant = f'<plant id="car" fmu="{fmu}"><binding vehicle="car_like">{role}</binding></plant>'
    text = scenario(tmp_path / "s.xml", plant).read_text("utf-8")
    added = '<input name="push"><constant value="1"/></input>'
    (tmp_path / "s.xml").write_text(text.replace("  <leader", f"  {added}\n  <leader"), "utf-8")
    with pytest.raises(InputError, match=re.escape(sentence)):
        Simulation(read_scenario(tmp_path / "s.xml"))


def test_messages_have_robot_and_time(make: Make, tmp_path: Path) -> None:
    fmu = make(behaviour="warning", when=0.94)
    said = [
        f"{robot}, t = {time} s: step returns warning at t = {time} s, as it was made to"
        for time in (0.94, 0.96, 0.98)
        for robot in ("leader", "follower_1")
    ]
    for isolate in ("", 'isolate="process"'):
        result = cosim.run(scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{fmu}" {isolate} time_limit="30 s"/>'))
        assert json.loads(result.attrs["plant_messages"]) == said
        data = zip(result.message_robot.values, result.message_time.values, result.message_text.values, strict=True)
        assert [f"{robot}, t = {time:g} s: {text}" for robot, time, text in data] == said
        assert set(result.message_status.values) == {"Warning"}
        assert set(result.message_category.values) <= {"stub", "logStatusWarning", "status", "logAll", ""}
        assert (result.message_count == 1).all()
        messages = json.loads(cosim.summary_of(result).to_json())["messages"]
        assert [f"{entry['robot']}, t = {entry['time']:g} s: {entry['text']}" for entry in messages] == said


@pytest.mark.parametrize("isolate", ["", 'isolate="process"'])
def test_messages_of_a_failure_are_kept_as_data(make: Make, tmp_path: Path, isolate: str) -> None:
    fmu = make(behaviour="error", when=0.5)
    with pytest.raises(SimulationError) as failed:
        cosim.run(scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{fmu}" {isolate} time_limit="30 s"/>'))
    result = failed.value.result
    row = result.sel(message=result.message_robot == failed.value.robot).isel(message=0)
    assert str(row.message_status.values) == "Error"
    assert float(row.message_time) == failed.value.time == 0.5
    assert str(row.message_text.values) in str(failed.value)
    assert str(row.message_text.values) in [message.text for message in cosim.summary_of(result).messages]


# Our own ----------------------------------------------------------------------------------------------------

OURS = '<plant id="car" fmu="{fmu}" {attributes} time_limit="30 s">{parameters}</plant>'
EULER = '<parameter name="solver" value="euler"/><parameter name="solver_step" value="20 ms"/>'


@pytest.fixture(scope="module")
def ours(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Floats]:
    """Return a function that runs our own robot in a closed loop: the poses."""
    folder = tmp_path_factory.mktemp("ours")

    @cache
    def run(fmi: str, attributes: str, parameters: str) -> Floats:
        plant = OURS.format(fmu=plants.build("car_like", fmi=fmi), attributes=attributes, parameters=parameters)
        poses: Floats = cosim.run(scenario(folder / "s.xml", plant, horizon="4 s", followers=["car"] * 2)).pose.values
        return poses

    return run


@pytest.mark.parametrize("isolate", ["", 'isolate="process"'], ids=["in_process", "isolated"])
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_our_robot_is_the_same_by_co_simulation_to_the_bit(ours: Callable[..., Floats], fmi: str, isolate: str) -> None:
    np.testing.assert_array_equal(ours(fmi, isolate, EULER), ours("2.0", "", EULER))


@pytest.mark.parametrize("isolate", ["", 'isolate="process"'], ids=["in_process", "isolated"])
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_our_robot_is_the_same_by_model_exchange_within_rounding(
    ours: Callable[..., Floats], fmi: str, isolate: str
) -> None:
    """The FMU's own method and ours add up in different order; the closed loop amplifies the rounding."""
    model = f'interface="model_exchange" solver="euler" {isolate}'
    np.testing.assert_allclose(ours(fmi, model, ""), ours("2.0", "", EULER), rtol=0.0, atol=1e-9)
    np.testing.assert_array_equal(ours(fmi, model, ""), ours("2.0", model.replace(isolate, ""), ""))


# How it is built --------------------------------------------------------------------------------------------


def test_a_spec_is_the_same_after_its_journey() -> None:
    spec = PlantSpec(
        robot="ä \ud800".encode("utf-8", "replace").decode(),
        file="a.fmu",
        directory="/tmp/x",
        fmi="3.0",
        interface="model_exchange",
        identifier="a",
        token="{}",
        values=(
            Value("x", "Float64", 1, (0.1, math.inf, -0.0)),
            Value("s", "String", 2, ("ß",)),
            Value("b", "Boolean", 3, (True,)),
        ),
        inputs=Block((1, 2), (1 / 3, 1e-300), (Exchanged("a", "Real"), Exchanged("b", "Float32", 1))),
        outputs=Block((), (), ()),
        stop_time=1 / 3,
    )
    assert PlantSpec.from_json(spec.to_json()) == spec
    assert math.copysign(1.0, PlantSpec.from_json(spec.to_json()).values[0].values[2]) == -1.0  # type: ignore[arg-type]


@pytest.mark.skipif(not COMPILED or sys.platform == "win32", reason="compiled code that sleeps by POSIX")
def test_while_compiled_code_runs_other_threads_do_too() -> None:
    """As an FMU may log from a thread of its own, and wait for it in a step."""
    call = c_function("int")
    address = ctypes.cast(ctypes.CDLL(None).usleep, ctypes.c_void_p).value
    begun, seen = threading.Event(), []

    @compiled
    def sleep(address: int) -> int:
        return call(address, (np.int32(300_000),))

    sleep(address)
    done = threading.Event()

    def other() -> None:
        begun.wait()
        seen.append(done.wait(0.05))

    thread = threading.Thread(target=other)
    thread.start()
    begun.set()
    sleep(address)
    done.set()
    thread.join()
    assert seen == [False], "it has waited 0.05 s in vain, while the 0.3 s went by"


PLAIN = """
import sys
from pathlib import Path
import numpy as np
from cosim.tests.driving import drive
torques = np.load(sys.argv[1])
for number, (fmu, solver) in enumerate(zip(sys.argv[2::2], sys.argv[3::2])):
    np.save(f"{number}.npy", drive(Path(fmu), torques, solver=solver))
"""


def test_plain_python_moves_alike_to_the_bit(make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    cases = [(make(fmi=fmi), "") for fmi in FMI] + [
        (make(fmi=fmi, end_stop=0.3, time_event=True, **MODEL), solver) for fmi in FMI[1:] for solver in SOLVERS
    ]
    np.save(tmp_path / "torques.npy", TORQUES)
    arguments = [str(argument) for case in cases for argument in case]
    subprocess.run([sys.executable, "-c", PLAIN, str(tmp_path / "torques.npy"), *arguments], cwd=tmp_path, check=True)
    for number, (fmu, solver) in enumerate(cases):
        np.testing.assert_array_equal(np.load(tmp_path / f"{number}.npy"), drive(fmu, TORQUES, solver=solver))


def test_an_end_that_is_interrupted_leaves_no_instance(
    make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Messages of the next one would go to it: with FMI 1.0 only the name tells them apart."""
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{make(fmi="1.0")}" isolate="no"/>')

    def interrupted(_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("fmpy.fmi1.FMU1Slave.terminate", interrupted)
    with pytest.raises(KeyboardInterrupt), Simulation(read_scenario(path)) as simulation:
        simulation.step()
    assert not Log._open


def test_threads_return_to_the_working_directory(make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """FMPy leaves it while it loads a library; a thread that begins then must not take that place for its own."""
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{make()}" isolate="no"/>')
    loads, begun = threading.Event(), threading.Event()
    original, home = fmpy.fmi1._FMU.__init__, os.getcwd()

    def slowly(fmu: Any, **about: Any) -> None:
        original(fmu, **about)
        os.chdir(tmp_path)  # as FMPy does for a moment
        loads.set()
        begun.wait(0.3)
        os.chdir(home)

    def other() -> None:
        loads.wait()
        with returning():
            begun.set()
            thread.join()

    def load() -> None:
        Simulation(read_scenario(path)).close()

    monkeypatch.setattr("fmpy.fmi1._FMU.__init__", slowly)
    thread = threading.Thread(target=load)
    thread.start()
    other()
    assert os.getcwd() == home
