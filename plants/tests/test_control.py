"""Models in python-control: simulation, linearisation, names, and errors."""

import sys

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import plants
from plants import numeric
from plants.control import linearise, nonlinear_io_system

from .test_models import spring

POINTS = {
    "car_like": (
        [1.0, -2.0, 0.5, 0.2, 1.3, -0.4],
        [8.0, 2.0, 1.0, -2.0, 0.5, 0.3],
        {"drive": "front_wheel", "F_c_v": 2.0},
    ),
    "tractor_trailer": ([1.0, -2.0, 0.5, 0.9, 1.3, -0.4], [3.0, 2.0, 1.0, -2.0, 0.5, 0.3], {"m_0": 20.0, "F_c_v": 2.0}),
    "differential_drive": ([1.0, -2.0, 0.5, 1.3, -0.4], [3.0, 2.0, 1.0, -2.0, 0.5], {"m_c": 20.0, "F_c_v": 2.0}),
}


@pytest.mark.parametrize("name", POINTS)
def test_simulation_agrees_with_scipy(name: str) -> None:
    x, u, parameters = POINTS[name]
    functions = numeric.compile(plants.load(name))
    p, times = functions.parameters(**parameters), np.linspace(0.0, 3.0, 31)
    tight = {"rtol": 1e-11, "atol": 1e-11}
    expected = solve_ivp(
        lambda t, x: functions.rhs(t, x, u, p), (0.0, 3.0), x, method="DOP853", t_eval=times, rtol=1e-13, atol=1e-13
    )
    system = nonlinear_io_system(name, parameters=parameters)
    response = control.input_output_response(
        system, times, np.outer(u, np.ones(31)), x, solve_ivp_method="DOP853", solve_ivp_kwargs=tight
    )
    np.testing.assert_allclose(response.states, expected.y, rtol=1e-8, atol=1e-8)
    np.testing.assert_array_equal(response.outputs[: len(x)], response.states)
    if name == "tractor_trailer":
        np.testing.assert_allclose(response.outputs[6], response.states[3] - response.states[2], rtol=1e-14)


@pytest.mark.parametrize("name", POINTS)
def test_linearisation_is_that_of_python_control(name: str) -> None:
    """python-control takes finite differences: equal to about their accuracy; ours is exact (see test_numeric.py)."""
    x, u, parameters = POINTS[name]
    ours = linearise(name, x, u, parameters)
    theirs = control.linearize(nonlinear_io_system(name, parameters=parameters), x, u, eps=1e-7, copy_names=True)
    for matrix in "ABCD":
        np.testing.assert_allclose(getattr(ours, matrix), getattr(theirs, matrix), rtol=1e-4, atol=1e-4)
    assert ours.state_labels == theirs.state_labels
    assert ours.input_labels == theirs.input_labels
    assert ours.output_labels == theirs.output_labels
    assert ours.name == name


def test_names_are_the_models() -> None:
    system = nonlinear_io_system("tractor_trailer", name="follower")
    model = plants.load("tractor_trailer")
    assert system.name == "follower"
    assert system.state_labels == [state.name for state in model.states]
    assert system.input_labels == [variable.name for variable in model.inputs]
    assert system.output_labels == [*system.state_labels, "hitch"]


def test_states_that_are_no_outputs() -> None:
    system, linear = nonlinear_io_system(spring()), linearise(spring(), {"rate": 2.0})
    assert system.output_labels == linear.output_labels == ["s", "energy"]
    np.testing.assert_allclose(linear.C, [[1.0, 0.0], [0.0, 2.0]])
    np.testing.assert_allclose(linear.D, [[0.0], [np.pi]])


def test_a_point_may_be_given_by_name() -> None:
    by_name = linearise("car_like", {"v": 1.0}, {"tau_drive": 8.0})
    in_full = linearise("car_like", [0, 0, 0, 0, 1.0, 0], [8.0, 0, 0, 0, 0, 0])
    np.testing.assert_array_equal(by_name.A, in_full.A)
    assert not np.array_equal(by_name.A, linearise("car_like").A)


def test_parameters_can_be_changed_in_a_simulation() -> None:
    system, times = nonlinear_io_system("car_like", parameters={"d_x": 0.0}), np.linspace(0.0, 1.0, 11)
    torque = np.zeros((6, 11))
    torque[0] = 6.0
    for mass, params in ((30.0, {}), (15.0, {"m_c": 15.0})):
        response = control.input_output_response(system, times, torque, params=params)
        assert response.states[4, -1] == pytest.approx(6.0 / mass, rel=1e-6)


def test_a_feedback_designed_on_the_linear_model_holds_the_nonlinear_one() -> None:
    """Straight along the X axis at 1 m/s, steered by the difference of the torques, with a reach that is not small."""
    linear = linearise("tractor_trailer", {"v": 1.0}, {"tau_right": 1.875, "tau_left": 1.875})
    part = [1, 2, 3, 5]  # y, theta_1, theta_0, omega
    A, B = linear.A[np.ix_(part, part)], linear.B[part, :2] @ [[1.0], [-1.0]]
    gain, _, _ = control.lqr(A, B, np.eye(4), 0.1 * np.eye(1))
    functions = numeric.compile(plants.load("tractor_trailer"))
    p = functions.parameters()
    x = np.array([0.0, 0.4, 0.2, -0.2, 1.0, 0.0])
    for k in range(2000):
        steer = float((-gain @ x[part])[0])
        x = functions.rk4(k * 0.01, x, functions.inputs(tau_right=1.875 + steer, tau_left=1.875 - steer), p, 0.01)
    np.testing.assert_allclose(x[part], 0.0, atol=1e-3)
    assert x[4] == pytest.approx(1.0, rel=1e-3)


# ---- what can go wrong ----


def test_python_control_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "control", None)
    for call in (nonlinear_io_system, linearise):
        with pytest.raises(plants.PlantError, match=r"python-control is not installed.*formation-cosim\[control\]"):
            call("car_like")


def test_bad_arguments_are_named() -> None:
    with pytest.raises(plants.UnknownModel, match="no plant model 'bicycle'"):
        nonlinear_io_system("bicycle")
    with pytest.raises(plants.ModelError, match="there is no parameter 'mass'"):
        nonlinear_io_system("car_like", parameters={"mass": 3.0})
    with pytest.raises(plants.ModelError, match="there is no state 'speed'"):
        linearise("car_like", {"speed": 3.0})
    with pytest.raises(plants.ModelError, match=r"u has the shape \(2,\), it must be \(6,\)"):
        linearise("car_like", u=[1.0, 2.0])
