"""The rules of the base class for every controller, with a small law in plain NumPy."""

from __future__ import annotations

import io
import math
import subprocess
import sys
import threading
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from formation_controllers import (
    CarLike,
    ControllerError,
    Desired,
    Entry,
    FormationGeometry,
    GainError,
    Gains,
    Leader,
    Signal,
    Team,
    TorqueMap,
    TractorTrailer,
    load,
)
from formation_controllers.controller import Controller
from formation_controllers.gains import gain
from formation_controllers.geometry import (
    first_range_bearing,
    formation_rates,
    input_matrix,
    range_bearing,
    unwrapped_bearing,
)
from formation_controllers.interface import CompiledStart, CompiledTick
from formation_controllers.neural_adaptive_pid import NeuralAdaptivePidGains
from formation_controllers.testing import VEHICLES, _course, check_controller

TEAM = Team(CarLike(1.2), 3, 0.02)
POSE = np.array([[-5.0, 0, 0, 0], [-5, 3, 0.1, 0], [-4, -3, -0.1, 0.2]])
LEADER = Leader(np.zeros(4), np.array([0.3, 0.0]))
DESIRED = Desired(np.tile([3.0, 0.5], (3, 1)), np.zeros((3, 2)), np.zeros((3, 2)))


@dataclass(frozen=True)
class IntegralGains(Gains):
    k: float = gain(2.0, "k", "N/s", "integral gain", above=0)


class Integral(Controller[IntegralGains]):
    """Torque: the integral of the error of range and bearing."""

    interface = "1.0"
    vehicles = ("car_like",)
    gains_type = IntegralGains
    signals = (Signal("error", "mixed", "error of q", ("range", "bearing")), Signal("ticks", "1", "ticks"))

    def state_shapes(self):
        return {"integral": (2,), "ticks": ()}

    def on_start(self, pose, leader, desired):
        self._state["ticks"] = 1.0

    def on_step(self, pose, leader, desired):
        error = desired.q - range_bearing(pose, leader.pose, self.team.vehicle)
        torque = self.gains.k * self._state["integral"]
        self._telemetry["error"], self._telemetry["ticks"] = error, self._state["ticks"]
        self._state["integral"] += self.team.period * error
        self._state["ticks"] += 1
        return torque


def started(controller_type=Integral):
    controller = controller_type(TEAM)
    controller.start(POSE, LEADER, DESIRED)
    return controller


def test_a_law_runs_and_tells_what_it_did():
    controller = started()
    assert np.isnan(controller.telemetry()["error"]).all()
    assert controller.step(POSE, LEADER, DESIRED).tolist() == [[0, 0]] * 3
    error = DESIRED.q - range_bearing(POSE, LEADER.pose, TEAM.vehicle)
    np.testing.assert_allclose(controller.step(POSE, LEADER, DESIRED), 2.0 * 0.02 * error)
    telemetry = controller.telemetry()
    np.testing.assert_array_equal(telemetry["error"], error)
    assert telemetry["ticks"].tolist() == [2, 2, 2]


def test_what_is_handed_out_is_not_the_controllers_own_memory():
    controller = started()
    controller.step(POSE, LEADER, DESIRED)
    before = controller.to_bytes()
    controller.telemetry()["ticks"][:] = 99
    controller.get_state()["integral"][:] = 99
    assert controller.to_bytes() == before
    assert controller.telemetry()["ticks"].tolist() == [1, 1, 1]


def test_inputs_may_be_lists_read_only_or_strided():
    expected = started().step(POSE, LEADER, DESIRED)
    frozen = POSE.copy()
    frozen.flags.writeable = False
    for pose in (POSE.tolist(), frozen, np.asfortranarray(POSE), np.repeat(POSE, 2, axis=0)[::2]):
        np.testing.assert_array_equal(started().step(pose, LEADER, DESIRED), expected)
    lists = Leader(LEADER.pose.tolist(), LEADER.velocity.tolist(), [0, 0]), Desired(*(a.tolist() for a in DESIRED))
    np.testing.assert_array_equal(started().step(POSE, *lists), expected)


@pytest.mark.parametrize(
    ("team", "message"),
    [
        ({"size": 0}, "0 followers"),
        ({"period": 0.0}, "period is 0.0 s: it must be a positive time"),
        ({"period": -0.02}, "period is -0.02 s"),
        ({"period": math.nan}, "period is nan s"),
        ({"period": "0.02"}, "period is 0.02 s: it must be a positive time"),
        ({"period": None}, "period is None s"),
        ({"period": True}, "period is True s"),
        ({"period": 10**400}, "it must be a positive time"),
        ({"period": 1j}, "period is 1j s"),
        ({"size": 3.0}, "the size of the team is 3.0: expected a whole number"),
        ({"size": "3"}, "the size of the team is '3': expected a whole number"),
        ({"size": True}, "the size of the team is True: expected a whole number"),
        ({"vehicle": None}, "the vehicle is None: expected one that states kind, pose, velocity"),
        (
            {"vehicle": CarLike},
            "the vehicle is <class .*CarLike'>: expected one that states kind, pose, velocity",
        ),
    ],
)
def test_an_impossible_team_is_refused(team, message):
    with pytest.raises(ControllerError, match=message):
        Team(**{"vehicle": CarLike(1.2), "size": 3, "period": 0.02} | team)


@pytest.mark.parametrize("name", ["lqg", "observer-pid"])
def test_a_period_may_be_a_fraction(name):
    pose, leader = np.array([[-5.0, 0.0, 0.0, 0.0]]), Leader(np.zeros(4), np.array([0.3, 0.0]))
    desired = Desired(np.array([[3.0, 0.5]]), np.zeros((1, 2)), np.zeros((1, 2)))
    torques = []
    for period in (Fraction(1, 50), 0.02):
        team = Team(CarLike(1.2), 1, period)
        assert type(team.period) is float
        controller = load(name)(team)
        controller.start(pose, leader, desired)
        torques.append(controller.step(pose, leader, desired))
    np.testing.assert_array_equal(*torques)


@pytest.mark.parametrize("value", ["1.2", None, True, 1j, [1.2], np.array([1.2]), 10**400, math.nan, -1])
def test_a_length_that_is_no_positive_number_is_refused(value):
    with pytest.raises(ControllerError, match=r"the wheelbase is .* m: it must be a positive length"):
        CarLike(value)
    with pytest.raises(ControllerError, match=r"the half track is .* m: it must be a positive length"):
        TractorTrailer(1.5, 0.15, value)


@pytest.mark.parametrize("drive", [None, 1, ["as_printed"], np.array(["as_printed"] * 2)])
def test_a_drive_that_is_no_name_is_refused(drive):
    with pytest.raises(ControllerError, match=r"unknown drive .* known: as_printed, front_wheel, rear_wheel"):
        CarLike(1.2, drive)


@dataclass(frozen=True)
class Bicycle:
    """A kinematic bicycle: a kind that this package does not know, with a speed and a steering angle as commands."""

    wheelbase: float = 1.2

    kind = "bicycle"
    pose = (Entry("x", "m"), Entry("y", "m"), Entry("heading", "rad"))
    velocity = (Entry("v", "m/s"), Entry("omega", "rad/s"))
    command = (Entry("speed", "m/s"), Entry("steering", "rad"))
    geometry = (Entry("wheelbase", "m"),)

    @property
    def formation(self):
        return FormationGeometry("none", self.wheelbase)


class Kinematic(Controller[IntegralGains]):
    """Speed and steering angle that make (v, omega) = R^-1 (-k (q - q_d) - delta)."""

    interface = "1.2"
    vehicles = ("bicycle",)
    needs = ("velocity",)
    gains_type = IntegralGains
    signals = (Signal("measured", "m/s", "speed"),)

    def state_shapes(self):
        return {}

    def on_start(self, pose, leader, desired):
        pass

    def on_step(self, pose, leader, desired):
        vehicle = self.team.vehicle
        R, delta = formation_rates(pose, leader.pose, leader.velocity[0], vehicle)
        q = range_bearing(pose, leader.pose, vehicle)
        self._telemetry["measured"] = self._velocity[:, 0]
        wanted = np.array([g.k for g in self.robot_gains])[:, None] * (desired.q - q) - delta
        v, omega = np.array([np.linalg.solve(*pair) for pair in zip(R, wanted, strict=True)]).T
        return np.column_stack([v, np.arctan(vehicle.wheelbase * omega / v)])


def test_a_kind_of_vehicle_from_outside_has_arrays_of_its_own_size():
    """Three pose entries, commands that are no torques: the law holds a formation of bicycles."""
    check_controller(Kinematic, vehicle=Bicycle())
    controller = Kinematic(Team(Bicycle(), 2, 0.02), IntegralGains(k=1))
    pose = np.array([[-4.0, 1, 0], [-4, -1, 0.1]])
    desired = Desired(np.array([[3.0, 0.4], [3, -0.4]]), np.zeros((2, 2)), np.zeros((2, 2)))
    for k in range(1000):
        leader = Leader(np.array([0.01 * k, 0.0, 0.0]), np.array([0.5, 0.0]))
        if k == 0:
            controller.start(pose, leader, desired)
        speed, angle = controller.step(pose, leader, desired, np.zeros((2, 2))).T
        heading = pose[:, 2]
        rates = [speed * np.cos(heading), speed * np.sin(heading), speed * np.tan(angle) / 1.2]
        pose = pose + 0.02 * np.column_stack(rates)
    np.testing.assert_allclose(range_bearing(pose, leader.pose, Bicycle()), desired.q, atol=0.02)


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        ({"pose": np.zeros((2, 4))}, r"pose has shape \(2, 4\): expected \(2, 3\)"),
        ({"pose": [[0, 0, 0], [0, 0, math.nan]]}, "robot 1: pose component heading is nan"),
        ({"leader": Leader(np.zeros(4), np.zeros(2))}, r"the leader's pose has shape \(4,\): expected \(3,\)"),
        ({"velocity": [[0, 0], [math.inf, 0]]}, "robot 1: velocity component v is inf"),
    ],
)
def test_what_does_not_fit_a_kind_from_outside_is_named_by_its_entries(inputs, message):
    pose, desired = np.array([[-4.0, 1, 0], [-4, -1, 0]]), Desired(np.ones((2, 2)), *np.zeros((2, 2, 2)))
    fine = {"pose": pose, "leader": Leader(np.zeros(3), np.zeros(2)), "desired": desired, "velocity": np.zeros((2, 2))}
    controller = Kinematic(Team(Bicycle(), 2, 0.02))
    controller.start(pose, fine["leader"], desired)
    with pytest.raises(ControllerError, match=message):
        controller.step(**fine | inputs)


def test_a_command_that_is_no_torque_is_not_called_one():
    class Broken(Kinematic):
        def on_step(self, pose, leader, desired):
            return np.full((2, 2), math.nan)

    desired = Desired(np.ones((2, 2)), *np.zeros((2, 2, 2)))
    inputs = np.ones((2, 3)), Leader(np.zeros(3), np.zeros(2)), desired
    controller = Broken(Team(Bicycle(), 2, 0.02))
    controller.start(*inputs)
    with pytest.raises(ControllerError, match="robot 0: the command is not finite"):
        controller.step(*inputs, np.zeros((2, 2)))


def stating(**facts):
    """Return a bicycle that states other facts."""
    return type("Stating", (Bicycle,), facts)()


X_Y, HEADING = (Entry("x", "m"), Entry("y", "m")), Entry("heading", "rad")
TORQUES = (Entry("right", "N.m"), Entry("left", "N.m"))


@pytest.mark.parametrize(
    ("facts", "message"),
    [
        ({"kind": 3}, "expected one that states kind, pose, velocity, command and geometry, such as CarLike"),
        ({"pose": ("x", "y", "heading")}, r"its pose is \('x', 'y', 'heading'\), expected a tuple of Entry"),
        ({"velocity": None}, r"its velocity is None, expected a tuple of Entry\(name, unit\)"),
        ({"command": ()}, "its command has no entry"),
        ({"command": TORQUES[:1] * 2}, "its command has two entries named 'right'"),
        ({"pose": (HEADING, *X_Y)}, r"its pose begins with units rad, m, m: expected x \[m\], y \[m\] and a heading"),
        ({"pose": X_Y}, r"its pose begins with units m, m: expected x"),
        ({"geometry": (Entry("length", "m"),)}, "it states the geometry 'length' but has no such attribute"),
        ({"__hash__": None}, "it cannot be hashed: a frozen dataclass can"),
        ({"formation": 1.2}, "its formation is 1.2, expected a FormationGeometry"),
        ({"formation": FormationGeometry("angle", 1)}, r"steers by 'angle', but its pose has no fourth entry \[rad\]"),
        ({"velocity": TORQUES}, r"it states a formation, which is for velocities v \[m/s\] and omega \[rad/s\]"),
        ({"torques": TorqueMap("wheels")}, r"what torques do, but its commands are not two torques \[N.m\]"),
    ],
)
def test_a_vehicle_that_states_its_facts_wrongly_is_refused(facts, message):
    with pytest.raises(ControllerError, match=rf"the vehicle is .*Stating\(wheelbase=1.2\): .*{message}"):
        Team(stating(**facts), 1, 0.02)


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda: FormationGeometry("anlge", 1.0), "unknown steering 'anlge'; did you mean 'angle'"),
        (lambda: FormationGeometry("none", 0.0), "the length is 0.0 m: it must be a positive length"),
        (lambda: TorqueMap("wheel"), "unknown form of torques 'wheel'; did you mean 'wheels'"),
        (lambda: TorqueMap("wheels", -1.0), "the wheel radius is -1.0 m"),
    ],
)
def test_facts_that_make_no_sense_are_refused(made, message):
    with pytest.raises(ControllerError, match=message):
        made()


LAWS = ["feedback-linearisation", "lqg", "neural-adaptive-pid", "neural-high-gain", "observer-pid"]


@pytest.mark.parametrize("name", LAWS)
def test_our_laws_serve_any_kind_that_states_what_they_need_and_refuse_others(name):
    """A forklift steered as a car is, of a kind that nobody knows, gets a car's torques; a bicycle is refused."""
    law = load(name)

    class Forklift(CarLike):
        kind = "forklift"

    torques = []
    for vehicle in (CarLike(1.2), Forklift(1.2)):
        controller = law(Team(vehicle, 3, 0.02))
        controller.start(POSE, LEADER, DESIRED)
        torques.append(controller.step(POSE, LEADER, DESIRED, np.zeros((3, 2))))
    np.testing.assert_array_equal(*torques)
    with pytest.raises(
        ControllerError,
        match="serves vehicles of kind car_like, tractor_trailer, differential_drive, others that state their "
        "formation and torques, not bicycle",
    ):
        law(Team(Bicycle(), 3, 0.02))
    with pytest.raises(ControllerError, match="Narrow serves vehicles of kind boat, not car_like"):
        type("Narrow", (law,), {"vehicles": ("boat",)})(Team(CarLike(1.2), 3, 0.02))
    with pytest.raises(ControllerError, match="Vain needs a vehicle that states its formation and torques, which bicy"):
        type("Vain", (law,), {"vehicles": ("bicycle",)})(Team(Bicycle(), 3, 0.02))


def test_a_vehicle_without_a_formation_or_torques_has_no_geometry_of_either():
    silent = stating(formation=None)
    with pytest.raises(ControllerError, match=r"Stating.*: expected one that states its formation"):
        range_bearing(np.zeros(3), np.ones(3), silent)
    with pytest.raises(ControllerError, match=r"the vehicle Bicycle.* states no torques"):
        input_matrix(np.zeros(3), Bicycle())


def test_another_vehicle_is_refused():
    class Hovercraft(CarLike):
        kind = "hovercraft"

    with pytest.raises(ControllerError, match="Integral serves vehicles of kind car_like, not hovercraft"):
        Integral(Team(Hovercraft(1.2), 3, 0.02))


@pytest.mark.parametrize("team", [None, 3, (CarLike(1.2), 3, 0.02), Team])
def test_a_team_that_is_none_is_refused(team):
    with pytest.raises(ControllerError, match=r"the team of this Integral is .*: expected a Team"):
        Integral(team)


@pytest.mark.parametrize("given", [None, tuple(LEADER), [1.0], np.zeros(4), "ahead", DESIRED])
def test_a_leader_that_is_none_is_refused_and_changes_nothing(given):
    controller = started()
    before = controller.to_bytes()
    for call in (controller.step, controller.start):
        with pytest.raises(ControllerError, match=rf"the leader is a {type(given).__name__}: expected a Leader"):
            call(POSE, given, DESIRED)
    assert controller.to_bytes() == before


@pytest.mark.parametrize("given", [None, tuple(DESIRED), DESIRED.q, {"q": DESIRED.q}, LEADER])
def test_what_is_desired_and_is_no_desired_is_refused_and_changes_nothing(given):
    controller = started()
    before = controller.to_bytes()
    for call in (controller.step, controller.start):
        with pytest.raises(
            ControllerError, match=rf"the desired place is a {type(given).__name__}: expected a Desired"
        ):
            call(POSE, LEADER, given)
    assert controller.to_bytes() == before


def test_gains_of_another_law_are_refused():
    with pytest.raises(GainError, match="takes gains of IntegralGains, not of NeuralAdaptivePidGains"):
        Integral(TEAM, NeuralAdaptivePidGains())


@pytest.mark.parametrize(
    "call",
    [
        lambda c: c.step(POSE, LEADER, DESIRED),
        lambda c: c.get_state(),
        lambda c: c.to_bytes(),
    ],
)
def test_nothing_works_before_the_start_or_after_a_reset(call):
    with pytest.raises(ControllerError, match=r"call start\(\) first"):
        call(Integral(TEAM))
    controller = started()
    call(controller)
    controller.reset()
    with pytest.raises(ControllerError, match=r"call start\(\) first"):
        call(controller)


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        ({"pose": POSE[:2]}, r"pose has shape \(2, 4\): expected \(3, 4\)"),
        ({"pose": POSE[:, :3]}, r"pose has shape \(3, 3\): expected \(3, 4\)"),
        ({"pose": [["a"] * 4] * 3}, "pose is not an array of numbers"),
        ({"pose": [["1"] * 4] * 3}, "pose is not an array of numbers"),
        ({"pose": np.array([["1"] * 4] * 3, dtype=object)}, "pose is not an array of numbers"),
        ({"pose": np.ma.masked_greater(POSE, POSE.min())}, "pose has masked numbers"),
        ({"pose": [*np.ma.masked_greater(POSE, POSE.min())]}, "pose has masked numbers"),
        ({"pose": POSE + 0j}, "pose is not an array of numbers"),
        ({"pose": (POSE + 1j).tolist()}, "pose is not an array of numbers"),
        ({"pose": [[10**400] * 4] * 3}, "pose is not an array of numbers"),
        ({"leader": LEADER._replace(pose=np.zeros(3))}, r"leader's pose has shape \(3,\): expected \(4,\)"),
        ({"leader": LEADER._replace(velocity=np.zeros(3))}, "leader's velocity has shape"),
        ({"leader": LEADER._replace(acceleration=np.zeros(3))}, "leader's acceleration has shape"),
        ({"desired": DESIRED._replace(q=np.zeros((2, 2)))}, r"desired q has shape \(2, 2\): expected \(3, 2\)"),
        ({"desired": DESIRED._replace(q_dot=np.zeros(2))}, "desired q_dot has shape"),
        ({"desired": DESIRED._replace(q_ddot=np.zeros(2))}, "desired q_ddot has shape"),
    ],
)
def test_shapes_that_do_not_fit_are_refused_and_change_nothing(inputs, message):
    controller = started()
    before = controller.to_bytes()
    arguments = {"pose": POSE, "leader": LEADER, "desired": DESIRED} | inputs
    for call in (controller.step, controller.start):
        with pytest.raises(ControllerError, match=message):
            call(**arguments)
    assert controller.to_bytes() == before


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    ("what", "index", "robot", "message"),
    [
        ("pose", (1, 2), 1, "robot 1: pose component psi is {}"),
        ("leader.pose", (3,), None, "the leader's pose component gamma is {}"),
        ("leader.velocity", (1,), None, "the leader's velocity component omega is {}"),
        ("leader.acceleration", (0,), None, "the leader's acceleration component v is {}"),
        ("desired.q", (2, 1), 2, "robot 2: the desired q component bearing is {}"),
        ("desired.q_dot", (0, 0), 0, "robot 0: the desired q_dot component range is {}"),
        ("desired.q_ddot", (0, 1), 0, "robot 0: the desired q_ddot component bearing is {}"),
    ],
)
def test_numbers_that_are_not_finite_are_refused_by_robot_and_component(what, index, robot, message, value):
    arrays = {
        "pose": POSE,
        **{f"leader.{n}": v for n, v in LEADER._replace(acceleration=np.zeros(2))._asdict().items()},
    }
    arrays |= {f"desired.{n}": v for n, v in DESIRED._asdict().items()}
    arrays = {name: array.copy() for name, array in arrays.items()}
    arrays[what][index] = value
    leader = Leader(*(arrays[f"leader.{n}"] for n in Leader._fields))
    desired = Desired(*(arrays[f"desired.{n}"] for n in Desired._fields))
    controller = started()
    before = controller.to_bytes()
    with pytest.raises(ControllerError, match=message.format(value)) as caught:
        controller.step(arrays["pose"], leader, desired)
    assert caught.value.robot == robot
    assert controller.to_bytes() == before


def test_a_start_that_the_law_refuses_changes_nothing():
    class Choosy(Integral):
        def on_start(self, pose, leader, desired):
            super().on_start(pose, leader, desired)
            if desired.q[0, 0] > 5:
                raise ControllerError("too far")

    far = DESIRED._replace(q=DESIRED.q + 10)
    fresh = Choosy(TEAM)
    with pytest.raises(ControllerError, match="too far"):
        fresh.start(POSE, LEADER, far)
    with pytest.raises(ControllerError, match=r"call start\(\) first"):
        fresh.step(POSE, LEADER, DESIRED)

    running, twin = started(Choosy), started(Choosy)
    running.step(POSE, LEADER, DESIRED)
    twin.step(POSE, LEADER, DESIRED)
    with pytest.raises(ControllerError, match="too far"):
        running.start(POSE, LEADER, far)
    assert running.to_bytes() == twin.to_bytes()
    for name, value in twin.telemetry().items():
        np.testing.assert_array_equal(running.telemetry()[name], value)
    np.testing.assert_array_equal(running.step(POSE, LEADER, DESIRED), twin.step(POSE, LEADER, DESIRED))


def test_a_torque_that_is_not_finite_is_refused_with_what_is_known():
    class Broken(Integral):
        def on_step(self, pose, leader, desired):
            torque = super().on_step(pose, leader, desired)
            torque[2, 0] = math.nan
            return torque

    with pytest.raises(ControllerError, match=r"robot 2: the torque is not finite, at error = .*, ticks = 1.0 1") as e:
        started(Broken).step(POSE, LEADER, DESIRED)
    assert e.value.robot == 2
    assert not e.value.message.startswith("robot")


@pytest.mark.parametrize(
    ("torque", "message"),
    [
        (np.zeros(2), r"the torque of Broken has shape \(2,\): expected \(3, 2\)"),
        ([1.0], r"the torque of Broken has shape \(1,\): expected \(3, 2\)"),
        (None, r"the torque of Broken has shape \(\): expected \(3, 2\)"),
        ("much", "the torque of Broken is not an array of numbers"),
    ],
)
def test_a_torque_of_the_wrong_shape_is_refused(torque, message):
    class Broken(Integral):
        def on_step(self, pose, leader, desired):
            return torque

    with pytest.raises(ControllerError, match=message):
        started(Broken).step(POSE, LEADER, DESIRED)


def test_state_goes_on_in_another_controller():
    controller = started()
    for _ in range(3):
        controller.step(POSE, LEADER, DESIRED)
    by_value, by_bytes = Integral(TEAM), Integral(TEAM)
    by_value.set_state(controller.get_state())
    by_bytes.from_bytes(controller.to_bytes())
    torque = controller.step(POSE, LEADER, DESIRED)
    np.testing.assert_array_equal(by_value.step(POSE, LEADER, DESIRED), torque)
    np.testing.assert_array_equal(by_bytes.step(POSE, LEADER, DESIRED), torque)


def test_a_copy_goes_its_own_way():
    controller = started()
    twin = controller.copy()
    controller.step(POSE, LEADER, DESIRED)
    before = twin.get_state()
    controller.step(POSE, LEADER, DESIRED)
    assert before["ticks"].tolist() == twin.get_state()["ticks"].tolist() == [1, 1, 1]


def test_states_that_do_not_fit_are_refused_and_change_nothing():
    controller = started()
    state, before = controller.get_state(), controller.to_bytes()
    with pytest.raises(ControllerError, match=r"states are \['ticks'\]: expected \['integral', 'ticks'\]"):
        controller.set_state({"ticks": state["ticks"]})
    with pytest.raises(ControllerError, match=r"state 'integral' has shape \(2, 2\): expected \(3, 2\)"):
        controller.set_state(state | {"integral": np.zeros((2, 2))})
    with pytest.raises(ControllerError, match=r"the state is a list: expected a mapping"):
        controller.set_state(["integral", "ticks"])
    for value in (math.nan, math.inf):
        lost = state | {"integral": state["integral"].copy()}
        lost["integral"][1, 0] = value
        with pytest.raises(ControllerError, match="robot 1: state 'integral' is not finite"):
            controller.set_state(lost)
    archive, infinite = io.BytesIO(), io.BytesIO()
    np.savez(archive, **state)
    records = np.load(io.BytesIO(before))
    records["ticks"][2] = math.inf
    np.save(infinite, records)
    with pytest.raises(ControllerError, match="robot 2: state 'ticks' is not finite"):
        controller.from_bytes(infinite.getvalue())
    garbage = (b"", b"nonsense", b"PK\x03\x04nonsense", before[: len(before) // 2], before[:20] + b"((" + before[22:])
    for data in (*garbage, archive.getvalue(), "a text", None, 3.0):
        with pytest.raises(ControllerError, match="the bytes are not a controller's state"):
            controller.from_bytes(data)
    other = Integral(Team(CarLike(1.2), 2, 0.02))
    with pytest.raises(ControllerError, match=r"shape \(3, 2\): expected \(2, 2\)"):
        other.from_bytes(before)
    assert controller.to_bytes() == before


def test_what_controllers_promise_is_checked():
    check_controller(Integral)


class WholeTeam(Integral):
    def on_step(self, pose, leader, desired):
        return super().on_step(pose, leader, desired) + pose.mean(axis=0)[:2]


class Neighbours(Integral):
    """Rows between the first and the last are coupled, in any order."""

    def on_step(self, pose, leader, desired):
        torque = super().on_step(pose, leader, desired)
        torque[1:-1] += pose[1:-1, :2].sum(axis=0)
        return torque


class Place(Integral):
    def on_step(self, pose, leader, desired):
        return super().on_step(pose, leader, desired) + np.arange(len(pose))[:, None]


class Hidden(Integral):
    calls = 0

    def on_step(self, pose, leader, desired):
        self.calls += 1
        return super().on_step(pose, leader, desired) + self.calls


class Clobbers(Integral):
    def on_step(self, pose, leader, desired):
        torque = super().on_step(pose, leader, desired)
        pose += 1.0
        return torque


class Silent(Integral):
    signals = (*Integral.signals, Signal("forgotten", "1", "never written"))


class Random(Integral):
    random = np.random.default_rng(0)

    def on_step(self, pose, leader, desired):
        return super().on_step(pose, leader, desired) + self.random.normal()


class Anonymous(Integral):
    interface = None


class Later(Integral):
    interface = "9.9"


class Once(Integral):
    """A signal of the first step stays as it is."""

    signals = (*Integral.signals, Signal("first", "1", "written at the first step only"))

    def on_step(self, pose, leader, desired):
        torque = super().on_step(pose, leader, desired)
        if self._state["ticks"][0] == 2:
            self._telemetry["first"] = 1.0
        return torque


class Counting(Integral):
    calls = 0

    def on_step(self, pose, leader, desired):
        torque = super().on_step(pose, leader, desired)
        self.calls += 1
        self._telemetry["ticks"] = self.calls
        return torque


class TeamSignal(Integral):
    def on_step(self, pose, leader, desired):
        torque = super().on_step(pose, leader, desired)
        self._telemetry["ticks"] = pose.sum()
        return torque


class NeverAlone(Integral):
    def on_step(self, pose, leader, desired):
        if len(pose) < 2:
            raise ValueError("no team")
        return super().on_step(pose, leader, desired)


class Remembers(Integral):
    """The signals of the step before are taken for state."""

    def on_step(self, pose, leader, desired):
        before = np.nan_to_num(self._telemetry["error"])
        return super().on_step(pose, leader, desired) + before


class LastBearing(Integral):
    """The bearing of the last tick is kept outside of the state."""

    def __init__(self, team, gains=None):
        super().__init__(team, gains)
        self.last = np.zeros(team.size)

    def on_start(self, pose, leader, desired):
        super().on_start(pose, leader, desired)
        self.last = first_range_bearing(pose, leader.pose, desired.q, self.team.vehicle)[:, 1]

    def on_step(self, pose, leader, desired):
        bearing = range_bearing(pose, leader.pose, self.team.vehicle)[:, 1]
        self.last = unwrapped_bearing(bearing[None], self.last)[0]
        return super().on_step(pose, leader, desired) + self.last[:, None]


class OnlyFromStart(Integral):
    def on_start(self, pose, leader, desired):
        super().on_start(pose, leader, desired)
        self.factor = 1.0

    def on_step(self, pose, leader, desired):
        return self.factor * super().on_step(pose, leader, desired)


class Wraps(Integral):
    def on_step(self, pose, leader, desired):
        pose[:, 2] -= 2 * math.pi * np.round(pose[:, 2] / (2 * math.pi))
        return super().on_step(pose, leader, desired)


class WrapsAtStart(Integral):
    def on_start(self, pose, leader, desired):
        super().on_start(pose, leader, desired)
        pose[:, 2] -= 2 * math.pi * np.round(pose[:, 2] / (2 * math.pi))


class SignOfZero(Integral):
    calls = 0

    def on_step(self, pose, leader, desired):
        SignOfZero.calls += 1
        return np.copysign(0.0 * super().on_step(pose, leader, desired), 1 if SignOfZero.calls % 5 else -1)


class SameMemory(Integral):
    """The torques of every tick are in one array, which is legal; random ones, but at each twelfth tick, are not."""

    random = None

    def __init__(self, team, gains=None):
        super().__init__(team, gains)
        self.torque = np.empty((team.size, 2))

    def on_step(self, pose, leader, desired):
        self.torque[...] = super().on_step(pose, leader, desired)
        if self.random is not None and self._state["ticks"][0] % 12 != 1:
            self.torque += self.random.normal()
        return self.torque


class RandomMemory(SameMemory):
    random = np.random.default_rng(0)


class NotCopied(Integral):
    def __init__(self, team, gains=None):
        super().__init__(team, gains)
        self.lock = threading.Lock()


class NotPickled(Integral):
    def __init__(self, team, gains=None):
        super().__init__(team, gains)
        self.twice = lambda value: 2 * value


def constant_tick(inputs, own, commands):
    commands[...] = 7.0


class OtherTick(Integral):
    def compiled_tick(self):
        return CompiledTick(constant_tick, ())


class OtherSignals(Integral):
    """The torques of the compiled tick are right, but not its signals."""

    def compiled_tick(self):
        return CompiledTick(self.tick_without_signals, ())

    def tick_without_signals(self, inputs, own, commands):
        leader = Leader(inputs.leader_pose, inputs.leader_velocity, inputs.leader_acceleration)
        commands[...] = self.on_step(inputs.pose, leader, Desired(inputs.q_d, inputs.q_d_dot, inputs.q_d_ddot))
        self._telemetry["ticks"] = math.nan


class OtherState(OtherSignals):
    def tick_without_signals(self, inputs, own, commands):
        super().tick_without_signals(inputs, own, commands)
        self._telemetry["ticks"] = self._state["ticks"] - 1
        if self._state["ticks"][0] == 13:  # after the last step
            self._state["integral"] += 1.0


class OtherStart(Integral):
    """Its ticks count from one, the compiled start's from zero."""

    def compiled_start(self):
        return CompiledStart(lambda inputs, own: None, ())


class FirstUnknown(Integral):
    """A rate needs two samples: it is written at the first step, but as NaN."""

    def on_step(self, pose, leader, desired):
        torque = super().on_step(pose, leader, desired)
        self._telemetry["ticks"][self._state["ticks"] == 2] = math.nan
        return torque


class FailsTurnedBack(Integral):
    def on_step(self, pose, leader, desired):
        if (np.cos(pose[:, 2] - leader.pose[2]) < 0).any():
            raise ValueError("turned back")
        return super().on_step(pose, leader, desired)


class RefusesAll(Integral):
    def on_start(self, pose, leader, desired):
        raise ControllerError("never")


class FailsAgain(Integral):
    def on_start(self, pose, leader, desired):
        if hasattr(self, "started"):
            raise RuntimeError("once only")
        self.started = True
        super().on_start(pose, leader, desired)


class AcceptsNoNumber(Integral):
    def step(self, pose, leader, desired, velocity=None):
        if np.isnan(pose).any():
            raise ZeroDivisionError
        return super().step(pose, leader, desired, velocity)


class RefusesLargeBearings(Integral):
    """It keeps to Remark 2 of the paper, and says so at the start."""

    def on_start(self, pose, leader, desired):
        if (np.abs(desired.q[:, 1]) > math.pi / 2).any():
            raise ControllerError("a desired bearing is beyond 90 degrees")
        super().on_start(pose, leader, desired)


class RefusesTurnedBack(Integral):
    def on_step(self, pose, leader, desired):
        if (np.cos(pose[:, 2] - leader.pose[2]) < 0).any():
            raise ControllerError("a follower is turned back")
        return super().on_step(pose, leader, desired)


class RefusesAndHides(RefusesTurnedBack, Hidden):
    """Without the follower that is turned back, the other rules are checked."""


class Twice(Integral):
    signals = (*Integral.signals, *Integral.signals)


class Elsewhere(Integral):
    vehicles = ("hovercraft",)


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (WholeTeam, "a follower's torque depends on the rest of the team or on its place"),
        (Neighbours, "a follower's torque depends on the rest of the team or on its place"),
        (Place, "a follower's torque depends on the rest of the team or on its place"),
        (Hidden, "after a reset it gives other torques"),
        (Clobbers, "it changes its inputs"),
        (Silent, "signal forgotten is not finite at every step: at step"),
        (Random, "a second run gives other torques"),
        (Anonymous, "states the interface None, which is not a version"),
        (Later, r"speaks version 9\.9 of the controller interface, and version .* is spoken here"),
        (Once, "signal first is not finite at every step: at step"),
        (Counting, "after a reset it gives other signal ticks"),
        (TeamSignal, "a follower's signal ticks depends on the rest of the team or on its place"),
        (NeverAlone, "it fails in another team, of 1: ValueError: no team"),
        (Remembers, "without the signals of the step before, which are no state, it gives other torques"),
        (LastBearing, "a controller set from state gives other torques"),
        (
            OnlyFromStart,
            "a controller set from state fails at its steps, so that something is not in its state: Attrib",
        ),
        (Wraps, "it changes its inputs"),
        (WrapsAtStart, "it changes its inputs"),
        (SignOfZero, "a second run gives other torques"),
        (RandomMemory, "a second run gives other torques"),
        (NotCopied, "it cannot be copied: TypeError"),
        (NotPickled, "it cannot be pickled: AttributeError"),
        (OtherTick, "its compiled_tick gives other torques than step"),
        (OtherSignals, "its compiled_tick gives other signal ticks than step"),
        (OtherState, "its compiled_tick advances its state otherwise than step"),
        (OtherStart, "its compiled_start sets another state than start"),
        (FirstUnknown, "signal ticks is not finite at every step: at step 1 it is nan, also if it is not written"),
        (FailsTurnedBack, "it fails at a start or a step: ValueError: turned back"),
        (RefusesAll, "it fails at a start or a step: ControllerError: never"),
        (FailsAgain, "it fails after a reset: RuntimeError: once only"),
        (AcceptsNoNumber, "a pose that is not a number ends in ZeroDivisionError, expected a ControllerError"),
        (RefusesAndHides, "after a reset it gives other torques"),
        (Twice, "has two signals named 'error'"),
        (Elsewhere, "serves none of car_like, tractor_trailer, differential_drive: pass a vehicle that it serves"),
    ],
)
def test_a_broken_promise_is_found(broken, message):
    with pytest.raises(AssertionError, match=message):
        check_controller(broken)


@pytest.mark.parametrize("law", [RefusesLargeBearings, RefusesTurnedBack])
def test_a_law_may_refuse_a_follower_that_is_turned_back(law):
    check_controller(law)


@pytest.mark.parametrize("vehicle", VEHICLES.values(), ids=VEHICLES)
@pytest.mark.parametrize("size", [1, 4])
def test_the_check_turns_a_bearing_through_180_degrees(vehicle, size):
    """The desired bearing that it hands over is within half a turn."""
    course = _course(vehicle, size, 12)
    raw = np.array([range_bearing(pose, leader.pose, vehicle)[-1, 1] for pose, leader, *_ in course])
    assert np.abs(np.diff(raw)).max() > math.pi
    assert max(np.abs(desired.q[:, 1]).max() for _, _, desired, _ in course) < math.pi
    assert course[0][0][-1, 2] > math.pi


def test_a_law_may_use_the_memory_of_its_torques_again():
    check_controller(SameMemory)


def test_broken_promises_are_found_by_a_python_that_leaves_out_assertions():
    code = "from test_controller import Place, check_controller; check_controller(Place)"
    ended = subprocess.run(
        [sys.executable, "-O", "-c", code], cwd=Path(__file__).parent, capture_output=True, text=True
    )
    assert "AssertionError: Place on a car_like: a follower's torque depends on the rest of the team" in ended.stderr
