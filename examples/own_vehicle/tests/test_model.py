"""The plant: its equations in NumPy, its FMU, and what a bicycle does."""

import subprocess
import sys

import fmpy
import fmpy.validation
import numpy as np
import pytest
from kinematic_bicycle.model import model

import plants
from plants import numeric

STATES = ["x", "y", "psi", "v", "gamma"]
CIRCLE = {"v_command": 1.5, "gamma_command": 0.3}


@pytest.fixture(scope="module")
def functions():
    return numeric.compile(model())


def driven(functions, seconds, parameters=None, **commands):
    """Return the states after some seconds of constant commands from rest."""
    x, u, p = functions.start(), functions.inputs(**commands), functions.parameters(**(parameters or {}))
    for k in range(round(seconds / 0.01)):
        x = functions.rk4(k * 0.01, x, u, p, 0.01)
    return dict(zip(STATES, x, strict=True))


def test_it_follows_its_commands_with_a_lag(functions):
    after = driven(functions, 0.3, v_command=2.0, gamma_command=-0.2)
    assert after["v"] == pytest.approx(2.0 * (1 - np.exp(-0.3 / 0.3)), rel=1e-6)
    assert after["gamma"] == pytest.approx(-0.2 * (1 - np.exp(-0.3 / 0.1)), rel=1e-6)


def test_the_steering_ends_at_its_stop(functions):
    for side in (1, -1):
        assert driven(functions, 3, gamma_command=2.0 * side)["gamma"] == pytest.approx(side * np.radians(35))


@pytest.mark.parametrize("v", [1.5, -1.5])
def test_a_constant_steering_angle_is_a_circle(functions, v):
    """Of radius a/tan(gamma) about a centre to the left, forward and backward; the rear axle does not slip sideways."""
    x = functions.start(v=v, gamma=0.3)
    u, p = functions.inputs(v_command=v, gamma_command=0.3), functions.parameters()
    radius = 1.2 / np.tan(0.3)
    for k in range(1000):
        x = functions.rk4(k * 0.01, x, u, p, 0.01)
        assert np.hypot(x[0], x[1] - radius) == pytest.approx(radius, rel=1e-9)
    assert x[2] == pytest.approx(10 * v / radius, rel=1e-9)
    assert functions.outputs(0.0, x, u, p) == pytest.approx([v / radius])


def test_the_wheels_do_not_slip(functions):
    rng = np.random.default_rng(1)
    for _ in range(50):
        x = rng.uniform([-9, -9, -4, -3, -1.2], [9, 9, 4, 3, 1.2])
        rates = functions.rhs(0.0, x, functions.inputs(), functions.parameters(a=0.8))
        psi, gamma = x[2], x[4]
        front = rates[:2] + 0.8 * rates[2] * np.array([-np.sin(psi), np.cos(psi)])
        assert rates[1] * np.cos(psi) - rates[0] * np.sin(psi) == pytest.approx(0, abs=1e-12)
        assert front[1] * np.cos(psi + gamma) - front[0] * np.sin(psi + gamma) == pytest.approx(0, abs=1e-11)


@pytest.fixture(scope="module", params=["2.0", "3.0"])
def fmu(request, tmp_path_factory):
    return str(plants.build(model(), fmi=request.param, out=tmp_path_factory.mktemp("fmu")))


def test_its_fmu_is_valid(fmu):
    assert fmpy.validation.validate_fmu(fmu) == []


@pytest.mark.parametrize("interface", ["CoSimulation", "ModelExchange"])
def test_its_fmu_drives_like_the_equations(functions, fmu, interface):
    solver = {"solver": 2} if interface == "CoSimulation" else {}
    result = fmpy.simulate_fmu(
        fmu,
        fmi_type=interface,
        stop_time=5.0,
        output_interval=0.01,
        relative_tolerance=1e-9,
        start_values=CIRCLE | solver,
        output=STATES,
    )
    expected = driven(functions, 5, **CIRCLE)
    assert {name: result[name][-1] for name in STATES} == pytest.approx(expected, abs=1e-4)


def test_the_command_builds_it(tmp_path):
    command = [sys.executable, "-m", "kinematic_bicycle", str(tmp_path)]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert printed.strip() == str(tmp_path / "kinematic_bicycle.fmu")
    names = {variable.name for variable in fmpy.read_model_description(printed.strip()).modelVariables}
    assert {"x", "y", "psi", "v", "omega", "v_command", "gamma_command", "a"} <= names
