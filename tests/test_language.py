"""The scenario language in runs: events, inputs, rates, trajectories, robots' own values."""

# ruff: noqa: E501 (pieces of XML, one case a line)

import json
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import cosim

from .two_followers import two_followers

SCENARIO = two_followers(
    '<plant id="car" model="car_like"/><plant id="truck" model="tractor_trailer"/>',
    horizon="4 s",
    team='<sensor><noise x="1 mm" y="1 mm"/></sensor><actuator><saturation limit="200 N.m"/></actuator>',
)
TRUCK = """<follower id="truck" plant="truck" controller="pid">
    <pose x="-6 m" y="0 m" theta_1="0 deg" theta_0="0 deg"/>
    <desired range="3 m" bearing="0 deg"/>
    <sensor><noise x="1 mm" y="1 mm" theta_0="1 mrad"/></sensor>
  </follower>"""
TRAJECTORY = "".join(f'<waypoint at="{t} s" x="{0.5 * t} m" y="{0.01 * t * t} m"/>' for t in range(6))


def changed(*pairs: tuple[str, str]) -> str:
    text = SCENARIO
    for old, new in pairs:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def in_follower(robot: str, what: str) -> tuple[str, str]:
    """Return the change that gives a follower something after its place."""
    sign = "-" if robot == "two" else ""
    place = f'<desired range="3 m" bearing="{sign}30 deg"/>'
    return place, place + what


def at_end(what: str) -> tuple[str, str]:
    return "</scenario>", what + "</scenario>"


def spare(what: str) -> tuple[str, str]:
    """Return the change that adds a plant or a controller which no robot uses."""
    place = '<controller id="pid"' if what.startswith("<plant") else "<sensor>"
    return place, what + place


@pytest.fixture
def run(tmp_path: Path):
    def run_it(*pairs: tuple[str, str]) -> xr.Dataset:
        file = tmp_path / "scenario.xml"
        file.write_text(changed(*pairs), encoding="utf-8")
        return cosim.run(file)

    return run_it


@pytest.fixture
def refused(tmp_path: Path):
    def refuse(*pairs: tuple[str, str]) -> str:
        file = tmp_path / "scenario.xml"
        file.write_text(changed(*pairs), encoding="utf-8")
        with pytest.raises(cosim.InputError) as caught:
            cosim.run(file)
        assert caught.value.where is not None
        assert re.match(r".*scenario\.xml:\d+:\d+$", str(caught.value.where))
        return caught.value.message

    return refuse


def same_motion(a: xr.Dataset, b: xr.Dataset, robot: str) -> bool:
    return all(np.array_equal(a[name].sel(robot=robot), b[name].sel(robot=robot)) for name in ("pose", "torque"))


def first_difference(a: xr.Dataset, b: xr.Dataset, name: str, robot: str) -> float:
    differs = (a[name].sel(robot=robot) != b[name].sel(robot=robot)).any(axis=1)
    return float(a["time"].values[np.flatnonzero(differs)[0]])


# Events


def test_a_parameter_that_changes_acts_from_its_time_on_and_on_its_robot_alone(run) -> None:
    plain = run()
    heavy = run(at_end('<event at="1 s" robots="two"><parameter name="m_c" value="45 kg"/></event>'))
    assert same_motion(plain, heavy, "one")
    assert first_difference(plain, heavy, "velocity", "two") == pytest.approx(1.02)


def test_a_parameter_that_changes_at_the_start_is_as_one_that_is_set(run) -> None:
    event = run(at_end('<event at="0 s" robots="two"><parameter name="m_c" value="45 kg"/></event>'))
    own = run(in_follower("two", '<parameter name="m_c" value="45 kg"/>'))
    assert np.array_equal(event["pose"], own["pose"])
    assert not same_motion(own, run(), "two")


def test_a_robot_that_stops_gets_no_torque(run) -> None:
    result = run(at_end('<event at="1 s" robots="one leader"><stop/></event>'))
    stopped = result["time"] >= 1.0
    assert not result["torque"].sel(robot="one")[stopped].any()
    assert not result["leader_torque"][stopped].any()
    assert result["torque"].sel(robot="one")[~stopped].all()
    assert result["torque"].sel(robot="two")[stopped].all()


def test_nothing_drives_a_robot_that_stops(run) -> None:
    push = '<input name="tau_drive"><constant value="5 N.m"/></input>'
    torque = '<torque tau_drive="8 N.m"/>'
    stop = '<event at="1 s" robots="one leader"><stop/></event>'
    result = run((torque, torque + push), in_follower("one", push), at_end(stop))
    assert result["leader_torque"].values[[0, 49, 50, 200], 0].tolist() == [13, 13, 0, 0]
    assert not result["torque"].sel(robot="one")[50:].any()


def test_a_leader_manoeuvres(run) -> None:
    event = '<event at="2 s" robots="leader"><torque tau_drive="4 N.m" tau_steer="1 N.m"/></event>'
    torque = run(at_end(event))["leader_torque"]
    assert torque.values[[0, 99, 100, 200]].tolist() == [[8, 0], [8, 0], [4, 1], [4, 1]]


# Inputs


def test_a_torque_may_be_a_signal(run) -> None:
    torque = '<torque tau_drive="8 N.m"/>'
    sum_of_two = '<input name="tau_drive"><constant value="5 N.m"/><step value="3 N.m" at="0 s"/></input>'
    assert np.array_equal(run()["leader_pose"], run((torque, sum_of_two))["leader_pose"])


def test_a_disturbance_acts_on_its_robot_or_on_every_follower(run) -> None:
    wind = '<input name="tau_d_x"><pulse value="50 N" from="1 s" to="2 s"/></input>'
    plain, on_two = run(), run(in_follower("two", wind))
    assert same_motion(plain, on_two, "one")
    assert first_difference(plain, on_two, "velocity", "two") == pytest.approx(1.02)
    on_all = run(("<leader plant", wind + "<leader plant"))
    assert same_motion(on_all, on_two, "two")
    assert first_difference(plain, on_all, "velocity", "one") == pytest.approx(1.02)
    assert np.array_equal(plain["leader_pose"], on_all["leader_pose"])


def test_an_input_has_one_value_from_an_event_on(run) -> None:
    """Whatever its signals are; without any, it has the FMU's start value before."""
    stepped = run(in_follower("one", '<input name="tau_d_y"><step value="30 N" at="1 s"/></input>'))
    event = at_end('<event at="1 s" robots="one"><input name="tau_d_y" value="30 N"/></event>')
    given = run(event)
    assert same_motion(stepped, given, "one")
    assert same_motion(stepped, given, "two")
    besides = run(event, in_follower("one", '<input name="tau_d_y"><pulse value="5 N" from="1 s" to="2 s"/></input>'))
    assert same_motion(given, besides, "one")


def test_random_signals_of_the_team_and_of_a_robot_are_not_the_same(run) -> None:
    gust = '<input name="tau_drive"><random value="1 N.m" cutoff="5 Hz"/></input>'
    quiet = ('<sensor><noise x="1 mm" y="1 mm"/></sensor>', "")
    torque = "torque_command", "torque"
    one, both = (
        np.subtract(*(result[name].sel(robot="one").values[:, 0] for name in torque))
        for result in (
            run(quiet, in_follower("one", gust)),
            run(quiet, ("<leader plant", gust + "<leader plant"), in_follower("one", gust)),
        )
    )
    assert not np.allclose(both, 2 * one, atol=0.1)


def test_a_torque_of_a_follower_may_be_disturbed_after_its_actuator(run) -> None:
    result = run(in_follower("one", '<input name="tau_drive"><constant value="500 N.m"/></input>'))
    torque = result["torque"].sel(robot="one", torque_component="tau_drive")
    assert ((torque >= 300) & (torque <= 700)).all()


# Rates, trajectories, teams


def test_commands_are_held_between_the_ticks_of_the_controllers(run) -> None:
    result = run(('step="20 ms"', 'step="20 ms" period="60 ms"'))
    torque = result["torque"].values
    changes = np.flatnonzero((np.diff(torque, axis=0) != 0).any(axis=(1, 2))) + 1
    assert changes.tolist() == list(range(3, 201, 3))
    assert result["measured_pose"].diff("time").any(), "sensors go on at every step"


def test_a_leader_moves_along_its_waypoints(run) -> None:
    drive = ('<pose x="0 m" y="0 m" psi="0 deg" gamma="0 deg"/>', f"<trajectory>{TRAJECTORY}</trajectory>")
    result = run(drive, ('<torque tau_drive="8 N.m"/>', ""))
    at_2 = result["leader_pose"].sel(time=2.0).values
    assert at_2[:2] == pytest.approx([1.0, 0.04], abs=1e-12)
    assert at_2[2] == pytest.approx(np.arctan2(0.04, 0.5), abs=1e-9)
    assert result["leader_velocity"].sel(time=2.0).values[0] == pytest.approx(np.hypot(0.5, 0.04), abs=1e-9)


def test_a_mixed_team(run) -> None:
    result = run(at_end(TRUCK))
    assert result["pose_component"].values.tolist() == ["x", "y", "psi/theta_1", "gamma/theta_0"]
    assert result["torque_component"].values.tolist() == ["tau_drive/tau_right", "tau_steer/tau_left"]
    assert np.abs(result["range_error"][-1]).max() < np.abs(result["range_error"][0]).min()


def test_another_robot_changes_nothing_for_the_others(run) -> None:
    plain, more = run(), run(at_end(TRUCK))
    for robot in ("one", "two"):
        assert same_motion(plain, more, robot)
        assert np.array_equal(plain["measured_pose"].sel(robot=robot), more["measured_pose"].sel(robot=robot))


def test_gains_and_parameters_of_a_robots_own(run) -> None:
    own = run(in_follower("two", '<parameter name="m_c" value="40 kg"/><gain name="K_p" value="20"/>'))
    kind = run(
        ('<plant id="truck" model="tractor_trailer"/>', '<plant id="car2" model="car_like"><parameter name="m_c" value="40 kg"/></plant>'),
        ('<sensor><noise x="1 mm" y="1 mm"/></sensor>', '<controller id="pid2" name="neural-adaptive-pid" package="formation-controllers" version="~=0.1.0"><gain name="K_p" value="20"/></controller><sensor><noise x="1 mm" y="1 mm"/></sensor>'),
        ('id="two" plant="car" controller="pid"', 'id="two" plant="car2" controller="pid2"'),
    )  # fmt: skip
    assert same_motion(own, kind, "two")
    assert same_motion(own, run(), "one")
    assert not same_motion(own, run(), "two")


def test_what_followers_are_told_of_the_leader_may_be_wrong(run) -> None:
    result = run(('<torque tau_drive="8 N.m"/>', '<torque tau_drive="8 N.m"/><sensor><bias x="10 cm"/></sensor>'))
    told = result["measured_leader_pose"] - result["leader_pose"]
    assert told.values == pytest.approx(np.tile([0.1, 0, 0, 0], (201, 1)), abs=1e-12)
    assert not same_motion(result, run(), "one")


def test_what_no_robot_uses_changes_nothing(run) -> None:
    unused = '<controller id="spare" name="lqg" package="formation-controllers" version="~=0.1.0"/>'
    plain, more = run(), run(spare(unused))
    assert same_motion(plain, more, "one")
    assert list(plain.data_vars) == list(more.data_vars)
    for result in (plain, more):
        assert list(json.loads(result.attrs["plants"])) == ["car"]
        assert [one["name"] for one in json.loads(result.attrs["controllers"])] == ["neural-adaptive-pid"]


# Bad input


@pytest.mark.parametrize(
    ("pairs", "sentence"),
    [
        ([('tau_drive="8 N.m"', 'tau_right="8 N.m"')], "a car_like vehicle has no 'tau_right'; it has tau_drive, tau_steer"),
        ([('<pose x="-5 m" y="-2 m" psi="0 deg" gamma="0 deg"/>', '<pose x="-5 m" y="-2 m" theta_1="0 deg"/>')], "has no 'theta_1'"),
        ([('<pose x="-5 m" y="-2 m" psi="0 deg" gamma="0 deg"/>', '<pose x="-5 m" y="-2 m"/>')], "lacks psi, gamma"),
        ([in_follower("one", '<input name="tau_dx"><constant value="1 N"/></input>')], "no input 'tau_dx': did you mean 'tau_d_x'"),
        ([in_follower("one", '<input name="tau_d_x"><constant value="1 m"/></input>')], "m does not fit"),
        ([in_follower("one", '<sensor><delay time="20 ms" channels="z"/></sensor>')], "the pose of one, a car_like, has no channel 'z'"),
        ([in_follower("one", '<actuator><effectiveness factor="0.5" channels="tau"/></actuator>')], "has no channel 'tau'"),
        ([in_follower("one", '<sensor><delay time="30 ms"/></sensor>')], "is not a whole number of communication steps"),
        ([in_follower("one", '<gain name="K_q" value="20"/>')], "K_q"),
        ([in_follower("one", '<parameter name="m_x" value="20 kg"/>')], "no parameter 'm_x'"),
        ([in_follower("one", '<parameter name="a" value="-1 m"/>')], "out of bounds"),
        ([at_end('<event at="1 s" robots="one"><parameter name="solver_step" value="1 ms"/></event>')], "only a tunable parameter"),
        ([at_end('<event at="1 s" robots="one"><parameter name="a" value="1.3 m"/></event>')], "the parameter 'a' of car_like.fmu plays the role 'a' of the geometry, which cannot change during a run"),
        ([at_end('<event at="1 s" robots="three"><stop/></event>')], "no robot 'three'"),
        ([at_end('<event at="1 s" robots="leader"><stop/></event>\n<event at="2 s" robots="leader"><torque/></event>')], "comes after the <stop> of the leader"),
        ([at_end('<event at="5 s" robots="one"><stop/></event>')], "after the end of the run"),
        ([at_end('<event at="1 s" robots="one"><torque tau_drive="1 N.m"/></event>')], '<torque> needs robots="leader"'),
        ([('<torque tau_drive="8 N.m"/>', f"<trajectory>{TRAJECTORY}</trajectory>")], "a leader with a <trajectory> has no <pose>"),
        ([('<pose x="0 m" y="0 m" psi="0 deg" gamma="0 deg"/>', "")], "needs a <pose>"),
        ([("4 s", "6 s"), ('<pose x="0 m" y="0 m" psi="0 deg" gamma="0 deg"/>', f"<trajectory>{TRAJECTORY}</trajectory>"), ('<torque tau_drive="8 N.m"/>', "")], "must reach from 0 s to the horizon"),
        ([spare('<plant id="spare" model="car_lke"/>')], "did you mean 'car_like'"),
        ([spare('<plant id="spare" fmu="spare.fmu"/>')], "spare.fmu cannot be read: there is no such file"),
        ([spare('<plant id="spare" model="my.fmu"/>')], """car_like, differential_drive, tractor_trailer; a file is named by fmu="my.fmu\""""),
        ([spare('<plant id="spare" fmu="car_like"/>')], 'car_like is a built-in model, not a file: write model="car_like"'),
        ([spare('<plant id="spare" model="car_like"><parameter name="m_c" value="30 m"/></plant>')], "parameter m_c of car_like.fmu"),
        ([spare('<controller id="spare" name="lqr" package="formation-controllers" version="~=0.1.0"/>')], "no installed package offers a controller 'lqr'"),
        ([spare('<controller id="spare" name="lqg" package="other" version="~=0.1.0"/>')], "not from other"),
        ([spare('<controller id="spare" name="lqg" package="formation-controllers" version="&gt;99"/>')], "needs formation-controllers >99"),
        ([spare('<controller id="spare" name="lqg" package="formation-controllers" version="~=0.1.0"><gain name="K_q" value="1"/></controller>')], "K_q"),
        ([('step="20 ms"', 'step="20 ms" period="30 ms"')], "is not a whole number of communication steps"),
        ([('step="20 ms"', 'step="20 ms" period="0 ms"')], "is not a whole number of communication steps"),
    ],
)  # fmt: skip
def test_bad_input_is_refused_at_its_place(refused, pairs: list[tuple[str, str]], sentence: str) -> None:
    assert sentence in refused(*pairs)
