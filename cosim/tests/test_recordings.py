"""Recorded drives, judged by the expectations of a scenario."""

from __future__ import annotations

import gc
import json
import math
import os
import re
import resource
import shutil
import sys
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree
from lxml.etree import fromstring
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import cosim
from cosim.cli import main
from cosim.errors import InputError
from cosim.master.setup import set_up
from cosim.recordings import bag as bags
from cosim.recordings.judge import judge_drive
from cosim.recordings.judging import judged
from cosim.recordings.series import ClockGoesBack, sampled
from cosim.results.files import save
from cosim.results.result import Result
from cosim.scenario.grammar import NAMESPACE
from cosim.scenario.reader import read_scenario
from cosim.scenario.scenario import Scenario
from cosim.tests.driving import IN_A_SECOND

EPOCH = 1_777_887_000 * 10**9
STEP = 20_000_000
TYPES = get_typestore(Stores.ROS2_HUMBLE)


@pytest.fixture(scope="module")
def line(scenarios: Path) -> Scenario:
    """The first second of clmr_line, with expectations of it."""
    return read_scenario(scenarios / "clmr_line.xml").edited([*IN_A_SECOND], horizon=1.0)


@pytest.fixture(scope="module")
def run(line: Scenario) -> Result:
    return Result.of(cosim.run(line))


def verdicts(result: Any) -> list[tuple[object, ...]]:
    """Return what can be compared of verdicts; a NaN equals itself as a text."""
    return [
        (one.expectation, one.robot, repr(one.figure), repr(one.margin), one.passed, one.known_failure, one.detail)
        for one in cosim.summary_of(result).verdicts
    ]


# The same verdicts as the run -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["clmr_line", "tractor_trailer_circle", "mixed_team", "differential_drive"])
def test_an_exported_run_is_judged_as_the_run_was(scenarios: Path, tmp_path: Path, name: str) -> None:
    path = scenarios / f"{name}.xml"
    result = cosim.run(path)
    expected = verdicts(result)
    assert len(expected) > 3
    cosim.export_result(result, tmp_path / "a.mcap")
    judged = cosim.judge_recording(tmp_path / "a.mcap", path)
    assert verdicts(judged) == expected
    for signal in ("pose", "leader_pose", "range_error", "bearing_error"):
        assert judged[signal].values.tobytes() == result[signal].values.tobytes()
    if name == "mixed_team":
        cosim.export_result(result, tmp_path / "a.csv")
        assert verdicts(cosim.judge_recording(tmp_path / "a.csv", path)) == expected
        save(result, tmp_path / "result.nc")
        assert verdicts(cosim.judge_recording(tmp_path, path)) == expected
        cosim.save_report([judged], tmp_path / "page.html")


# Bags of others ---------------------------------------------------------------------------------------------


def stamp(time: int) -> Any:
    return TYPES.types["builtin_interfaces/msg/Time"](time // 10**9, time % 10**9)


def header(time: int, frame: str = "map") -> Any:
    return TYPES.types["std_msgs/msg/Header"](stamp(time), frame)


def pose(x: float, y: float, yaw: float) -> Any:
    types = TYPES.types
    return types["geometry_msgs/msg/Pose"](
        types["geometry_msgs/msg/Point"](x, y, 0.0),
        types["geometry_msgs/msg/Quaternion"](0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)),
    )


def odometry(time: int, place: tuple[float, float, float], rest: float) -> tuple[str, Any]:
    types, zero = TYPES.types, TYPES.types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    message = types["nav_msgs/msg/Odometry"](
        header(time),
        "base",
        types["geometry_msgs/msg/PoseWithCovariance"](pose(*place), np.zeros(36)),
        types["geometry_msgs/msg/TwistWithCovariance"](types["geometry_msgs/msg/Twist"](zero, zero), np.zeros(36)),
    )
    return "nav_msgs/msg/Odometry", message


def stamped(time: int, place: tuple[float, float, float], rest: float) -> tuple[str, Any]:
    return "geometry_msgs/msg/PoseStamped", TYPES.types["geometry_msgs/msg/PoseStamped"](header(time), pose(*place))


def transform(time: int, place: tuple[float, float, float], rest: float) -> tuple[str, Any]:
    types = TYPES.types
    own = pose(*place)
    moved = types["geometry_msgs/msg/Transform"](types["geometry_msgs/msg/Vector3"](*place[:2], 0.0), own.orientation)
    one = types["geometry_msgs/msg/TransformStamped"](header(time), "robot/base", moved)
    other = types["geometry_msgs/msg/TransformStamped"](header(time), "other", moved)
    return "tf2_msgs/msg/TFMessage", types["tf2_msgs/msg/TFMessage"]([other, one])


def joints(time: int, place: tuple[float, float, float], rest: float) -> tuple[str, Any]:
    message = TYPES.types["sensor_msgs/msg/JointState"](
        header(time), ["wheel", "steer"], np.array([0.0, -math.degrees(rest)]), np.zeros(0), np.zeros(0)
    )
    return "sensor_msgs/msg/JointState", message


Make = Callable[[int, tuple[float, float, float], float], tuple[str, Any]]


def bag(
    folder: Path,
    run: Result,
    make: Make = odometry,
    storage: StoragePlugin = StoragePlugin.SQLITE3,
    ticks: Iterable[int] = range(51),
    late: int = 0,
    turns: float = 0.0,
) -> Path:
    """Write a bag of the robots of a run, with other names, another clock and its own messages."""
    with Writer(folder, version=9, storage_plugin=storage) as writer:
        topics: dict[str, Any] = {}

        def put(topic: str, kind: str, message: Any, time: int) -> None:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=TYPES)
            writer.write(topics[topic], time, TYPES.serialize_cdr(message, kind))

        for k in ticks:
            time = EPOCH + k * STEP
            for row in range(1 + len(run.robots)):
                values = run["pose"].values[k, row - 1] if row else run["leader_pose"].values[k]
                place = (float(values[0]), float(values[1]), float(values[2]) + turns)
                put(f"/r{row}/where", *make(time, place, values[3]), time + late)
                put(f"/r{row}/joints", *joints(time, place, values[3]), time + late)
    return folder


def mapping(path: Path, robots: Iterable[str], more: str = "", robot: str = "") -> Path:
    """Write a mapping of such a bag."""
    steering = '<signal name="pose" component="gamma" topic="/r{}/joints" field="position[1]" unit="deg" factor="-1"/>'
    inside = "".join(
        f'<robot id="{name}" topic="/r{row}/where" {robot}>{steering.format(row)}</robot>'
        for row, name in enumerate(["leader", *robots])
    )
    path.write_text(f'<mapping xmlns="{NAMESPACE}" {more}>{inside}</mapping>', encoding="utf-8")
    return path


def close(judged: Any, run: Result) -> None:
    """Demand the motion of a run, but for rounding."""
    for signal in ("pose", "leader_pose", "range_error", "bearing_error"):
        np.testing.assert_allclose(judged[signal].values, run[signal].values, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("make", "robot"),
    [(odometry, ""), (stamped, ""), (transform, 'child_frame="robot/base"')],
)
@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_a_bag_of_real_robots(
    run: Result, line: Scenario, tmp_path: Path, make: Make, robot: str, storage: StoragePlugin
) -> None:
    recording = bag(tmp_path / "bag", run, make, storage, late=3_000_000, turns=4 * math.pi)
    drive = judge_drive(recording, line, mapping(tmp_path / "map.xml", run.robots, robot=robot))
    close(drive.drive.result, run)
    assert drive.drive.start == EPOCH
    by_run = {(one.expectation, one.robot): one for one in cosim.summary_of(run).verdicts}
    for verdict in drive.summary.verdicts:
        assert verdict.judged == (not verdict.expectation.startswith("regular"))
        if verdict.judged:
            expected = by_run[verdict.expectation, verdict.robot]
            assert verdict.passed == expected.passed
            assert repr(round(verdict.figure, 9)) == repr(round(expected.figure, 9))
    assert not drive.summary.passed


@pytest.mark.parametrize("length", [1.0, 2.0, 0.5])
def test_a_heading_of_a_tilted_pose_is_that_of_its_quaternion_of_any_length(length: float) -> None:
    """It is Rz(yaw) Rx(roll), with its axis ahead at the yaw."""
    yaw, roll = 2.5, 0.3
    cos, sin, tilted, level = math.cos(yaw / 2), math.sin(yaw / 2), math.sin(roll / 2), math.cos(roll / 2)
    own = [length * one for one in (cos * tilted, sin * tilted, sin * level, cos * level)]
    message = replace(pose(1.0, 2.0, 0.0), orientation=TYPES.types["geometry_msgs/msg/Quaternion"](*own))
    assert bags._yaw(message) == pytest.approx(yaw, abs=1e-12)


def test_a_bag_without_a_mapping_tells_its_topics(run: Result, line: Scenario, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no pose of any follower of the scenario, but /r0/joints, /r0/where, /r1/"):
        judge_drive(bag(tmp_path / "bag", run), line)


def test_a_single_file_of_a_bag(run: Result, line: Scenario, tmp_path: Path) -> None:
    for storage, suffix in ((StoragePlugin.SQLITE3, ".db3"), (StoragePlugin.MCAP, ".mcap")):
        (file,) = bag(tmp_path / suffix[1:], run, storage=storage).glob(f"*{suffix}")
        alone = shutil.copy(file, tmp_path / f"alone{suffix}")
        close(cosim.judge_recording(alone, line, mapping(tmp_path / "map.xml", run.robots)), run)


def test_the_log_clock(run: Result, line: Scenario, tmp_path: Path) -> None:
    recording = bag(tmp_path / "bag", run, late=7_000_000)
    drive = judge_drive(recording, line, mapping(tmp_path / "map.xml", run.robots, 'clock="log"'))
    assert drive.drive.start == EPOCH + 7_000_000
    close(drive.drive.result, run)


def test_a_stated_start(run: Result, line: Scenario, tmp_path: Path) -> None:
    recording = bag(tmp_path / "bag", run)
    map_file = mapping(tmp_path / "map.xml", run.robots, f'start="{EPOCH // 10**9 + 0.2:.1f} s"')
    drive = judge_drive(recording, line, map_file)
    np.testing.assert_allclose(drive.drive.result["pose"].values[:41], run["pose"].values[10:], atol=1e-9)
    np.testing.assert_array_equal(*drive.drive.result["pose"].values[40:42])  # held
    assert np.isnan(drive.drive.result["pose"].values[42:]).all()
    assert [(one.bridged, one.missing) for one in drive.drive.tracked] == [(1, 9)] * 5
    again = judge_drive(recording, line, map_file, start=EPOCH / 1e9)
    close(again.drive.result, run)


def test_another_reference_point(run: Result, line: Scenario, tmp_path: Path) -> None:
    recording = bag(tmp_path / "bag", run)
    map_file = mapping(tmp_path / "map.xml", run.robots, robot='ahead="20 cm" left="-10 cm"')
    found = cosim.judge_recording(recording, line, map_file)["pose"].values
    x, y, psi, _ = np.moveaxis(run["pose"].values, -1, 0)
    np.testing.assert_allclose(found[..., 0], x + 0.2 * np.cos(psi) + 0.1 * np.sin(psi), atol=1e-12)
    np.testing.assert_allclose(found[..., 1], y + 0.2 * np.sin(psi) - 0.1 * np.cos(psi), atol=1e-12)


def test_another_frame(run: Result, line: Scenario, tmp_path: Path) -> None:
    map_file = mapping(tmp_path / "map.xml", run.robots, robot='frame_x="1 m" frame_y="-2 m" frame_turn="30 deg"')
    found = judge_drive(bag(tmp_path / "bag", run), line, map_file)
    x, y, psi, gamma = np.moveaxis(run["pose"].values, -1, 0)
    cos, sin = math.cos(math.pi / 6), math.sin(math.pi / 6)
    expected = [1 + cos * x - sin * y, -2 + sin * x + cos * y, psi + math.pi / 6, gamma]
    np.testing.assert_allclose(np.moveaxis(found.drive.result["pose"].values, -1, 0), expected, atol=1e-12)
    for signal in ("range_error", "bearing_error"):  # the same in any frame
        np.testing.assert_allclose(found.drive.result[signal].values, run[signal].values, atol=1e-9)


@pytest.mark.parametrize("field", ["yaw", "pose x"])
def test_another_number_that_is_an_angle_of_a_message_is_no_heading(
    run: Result, line: Scenario, tmp_path: Path, field: str
) -> None:
    recording = bag(tmp_path / "bag", run)
    robot = 'ahead="20 cm" frame_turn="30 deg"'
    text = mapping(tmp_path / "map.xml", run.robots, robot=robot).read_text()
    expected = cosim.judge_recording(recording, line, tmp_path / "map.xml")["pose"].values
    other = f'topic="/r1/where" field="{field}"' + (' unit="rad"' if field != "yaw" else "")
    text = text.replace('topic="/r1/joints" field="position[1]" unit="deg" factor="-1"', other)
    (tmp_path / "map.xml").write_text(text)
    found = cosim.judge_recording(recording, line, tmp_path / "map.xml")["pose"].values
    np.testing.assert_array_equal(found[..., :3], expected[..., :3])
    recorded = run["pose"].values[:, 0, 2 if field == "yaw" else 0]
    np.testing.assert_allclose(np.exp(1j * found[:, 0, 3]), np.exp(1j * recorded), atol=1e-12)


@pytest.mark.parametrize(
    ("moved", "field"),
    [('ahead="1 m"', "yaw"), ('left="1 m"', "pose x"), ('frame_x="1 m"', "data"), ('frame_turn="90 deg"', "yaw")],
)
def test_a_pose_that_is_moved_is_from_one_topic(
    run: Result, line: Scenario, tmp_path: Path, moved: str, field: str
) -> None:
    text = mapping(tmp_path / "map.xml", run.robots, robot=moved).read_text()
    own = f'<signal name="pose" component="psi" topic="/r2/where" field="{field}"/></robot>'
    (tmp_path / "map.xml").write_text(text.replace("</robot>", own, 1))
    with pytest.raises(
        InputError, match=r"map\.xml:1:\d+: ahead, left and frame_\.\.\. of leader move x, y and heading"
    ):
        judge_drive(bag(tmp_path / "bag", run), line, tmp_path / "map.xml")


def test_a_virtual_leader(run: Result, line: Scenario, tmp_path: Path) -> None:
    recording = bag(tmp_path / "bag", run)
    text = mapping(tmp_path / "map.xml", run.robots).read_text()
    without = re.sub(r'<robot id="leader".*?</robot>', "", text)
    (tmp_path / "map.xml").write_text(without)
    drive = judge_drive(recording, line, tmp_path / "map.xml")
    details = {one.detail for one in drive.summary.verdicts if one.expectation.startswith("rms")}
    assert any("the recording has no x of the pose of leader; map it, or state from=" in one for one in details)
    assert not any(one.judged for one in drive.summary.verdicts)
    (tmp_path / "map.xml").write_text(without.replace("</mapping>", '<robot id="leader" from="scenario"/></mapping>'))
    close(cosim.judge_recording(recording, line, tmp_path / "map.xml"), run)


def test_the_result_of_a_run_that_did_not_reach_its_end(run: Result, line: Scenario, tmp_path: Path) -> None:
    save(run.within(slice(30)), tmp_path / "result.nc")
    drive = judge_drive(tmp_path, line)
    assert [one.missing for one in drive.drive.tracked] == [20] * 5
    assert not any(one.judged for one in drive.summary.verdicts)


# Gaps and faults --------------------------------------------------------------------------------------------


def test_a_gap_is_bridged_or_missing(run: Result, line: Scenario, tmp_path: Path) -> None:
    there = [k for k in range(51) if not 5 < k < 10 and not 30 < k < 36]
    recording = bag(tmp_path / "bag", run, ticks=there)
    drive = judge_drive(recording, line, mapping(tmp_path / "map.xml", run.robots, 'longest_gap="0.1 s"'))
    missing = np.isnan(drive.drive.result["range_error"].values).all(axis=1)
    assert np.flatnonzero(missing).tolist() == list(range(31, 36))
    follower = drive.drive.tracked[1]
    assert (follower.missing, follower.bridged, follower.samples) == (5, 4, 42)
    assert follower.longest_gap == pytest.approx(0.12)
    between = drive.drive.result["pose"].values[6:10]
    line_between = np.linspace(run["pose"].values[5], run["pose"].values[10], 6)[1:5]
    np.testing.assert_allclose(between, line_between, atol=1e-12)
    assert np.isfinite(drive.drive.result["bearing_error"].values[36:]).all()
    rms = next(one for one in drive.summary.verdicts if one.expectation.startswith("rms range_error"))
    assert not rms.judged
    assert not rms.passed
    assert rms.outcome == "not judged"
    assert rms.detail == "the recording has no range_error of follower_1 at 5 of 26 ticks, 0.62 to 0.7 s"


@pytest.mark.parametrize("of", ["reference_points", "bodies"])
def test_a_gap_of_a_robot_that_is_not_named_leaves_its_distance_open(
    run: Result, line: Scenario, tmp_path: Path, of: str
) -> None:
    """The nearest to a robot may be the one whose poses are missing."""
    other, named = run.robots[:2]
    text = line.text.replace("<expect>", f'<expect><distance of="{of}" above="1 mm" robots="{named}"/>')
    (tmp_path / "named.xml").write_text(text, encoding="utf-8")
    expecting = read_scenario(tmp_path / "named.xml")
    cosim.export_result(run, tmp_path / "a.csv")
    assert judge_drive(tmp_path / "a.csv", expecting).summary.verdicts[0].passed
    lines = (tmp_path / "a.csv").read_text().splitlines()
    column = lines[0].split(",").index(f"{other}.pose.x [m]")
    for at in range(10, 52):
        cells = lines[at].split(",")
        lines[at] = ",".join([*cells[:column], "nan", *cells[column + 1 :]])
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    found = judge_drive(tmp_path / "a.csv", expecting).summary.verdicts[0]
    assert not found.judged
    assert found.detail.startswith(f"the recording has no x of the pose of {other} at ")


def test_a_singularity_is_judged_by_what_is_recorded_of_those_who_are_named(
    run: Result, line: Scenario, tmp_path: Path
) -> None:
    """That the signals of another robot's law are not recorded says nothing about these robots."""
    with ExitStack() as ending:
        setup = set_up(line, ending, {})
        [regular] = [one for one in line.expectations if one.kind == "regular"]
        named, other = run.robots[:2]
        other_law = replace(setup.signals["cos_bearing"], robots=(other,))
        team = replace(setup, signals={**setup.signals, "cos_bearing": other_law})
        rest = Result({name: one for name, one in run.data_vars.items() if name != "cos_bearing"}, run.coords, {})
        found = judged(replace(line, expectations=(regular,)), team, rest, no_other)
        assert {one.robot: one.judged for one in found} == {robot: robot != other for robot in run.robots}
        only = judged(replace(line, expectations=(replace(regular, robots=(named,)),)), team, rest, no_other)
        assert [(one.robot, one.judged, one.passed) for one in only] == [(named, True, True)]


def expecting(line: Scenario, expected: str) -> Scenario:
    """Return the scenario with one expectation alone."""

    def only(root: Any) -> None:
        (place,) = root.findall("{*}expect")
        place[:] = [fromstring(expected.replace(" ", f' xmlns="{NAMESPACE}" ', 1))]

    return line.edited([only])


def test_the_leader_less_a_follower_is_judged_by_these_two(run: Result, line: Scenario, tmp_path: Path) -> None:
    cosim.export_result(run.dataset, tmp_path / "whole.csv")
    rows = [row.split(",") for row in (tmp_path / "whole.csv").read_text().splitlines()]
    of_others = [i for i, name in enumerate(rows[0]) if re.match(r"follower_[234]\.velocity", name)]
    own = rows[0].index("follower_1.velocity.v [m/s]")
    scenario = expecting(
        line,
        '<peak signal="leader_velocity" component="v" minus="velocity" minus_component="v" minus_robot="follower_1" '
        'below="10 m/s" fails="as is known"/>',
    )
    for row in rows[1:]:
        row[:] = ["" if i in of_others else cell for i, cell in enumerate(row)]
        (tmp_path / "part.csv").write_text("\n".join(map(",".join, rows)) + "\n")
    (verdict,) = cosim.summary_of(cosim.judge_recording(tmp_path / "part.csv", scenario)).verdicts
    assert (verdict.robot, verdict.judged, verdict.margin > 0) == ("leader", True, True)
    for row in rows[21:]:
        row[own] = ""
    (tmp_path / "gap.csv").write_text("\n".join(map(",".join, rows)) + "\n")
    of_all = '<peak signal="velocity" component="v" minus_robot="follower_1" below="10 m/s"/>'
    of_others = cosim.summary_of(cosim.judge_recording(tmp_path / "gap.csv", expecting(line, of_all))).verdicts
    assert [verdict.robot for verdict in of_others] == ["follower_2", "follower_3", "follower_4"]
    (verdict,) = cosim.summary_of(cosim.judge_recording(tmp_path / "gap.csv", scenario)).verdicts
    assert (verdict.robot, verdict.judged, verdict.known_failure) == ("leader", False, "")
    assert "v of the velocity of follower_1 at " in verdict.detail


def test_a_measured_heading_turns_the_shortest_way(run: Result, line: Scenario, tmp_path: Path) -> None:
    """As the true one does, though both jump by a turn between two samples."""
    cosim.export_result(run.dataset, tmp_path / "whole.csv")
    names, *rows = ([*row.split(",")] for row in (tmp_path / "whole.csv").read_text().splitlines())
    true, seen = (names.index(f"follower_1.{name}.psi [rad]") for name in ("pose", "measured_pose"))
    for number, row in enumerate(rows):
        heading = 3.0 + 0.01 * number  # beyond half a turn from 15 on
        row[true] = row[seen] = repr(math.remainder(heading, math.tau))
    (tmp_path / "part.csv").write_text("\n".join(map(",".join, [names, *rows[::3]])) + "\n")
    scenario = expecting(line, '<peak signal="measured_pose" component="psi" minus="pose" below="1 mrad"/>')
    judged = cosim.judge_recording(tmp_path / "part.csv", scenario)
    of_one = (judged[name].sel(robot="follower_1", pose_component="psi") for name in ("pose", "measured_pose"))
    pose, measured = (course.values[:49] for course in of_one)
    np.testing.assert_array_equal(measured, pose)
    np.testing.assert_allclose(np.diff(measured), 0.01, atol=1e-9)
    for number, row in enumerate(rows):  # more than a turn, of which the first samples are not measured
        row[true], row[seen] = repr(1.4 * number), repr(math.remainder(1.4 * number, math.tau))
        row[seen] = "" if number < 10 or 20 < number < 30 else row[seen]
    (tmp_path / "late.csv").write_text("\n".join(map(",".join, [names, *rows])) + "\n")
    judged = cosim.judge_recording(tmp_path / "late.csv", scenario)
    of_one = (judged[name].sel(robot="follower_1", pose_component="psi") for name in ("pose", "measured_pose"))
    pose, measured = (np.r_[course.values[10:21], course.values[30:]] for course in of_one)
    np.testing.assert_allclose(measured, pose, atol=1e-9)


def no_other(path: Path) -> Result:
    raise AssertionError(f"{path} is not to be run")


def test_what_is_not_judged_never_counts_as_known_to_fail(run: Result, line: Scenario, tmp_path: Path) -> None:
    text = line.text.replace("<regular", '<regular fails="the law is singular"')
    (tmp_path / "marked.xml").write_text(text, encoding="utf-8")
    marked = read_scenario(tmp_path / "marked.xml")
    drive = judge_drive(bag(tmp_path / "bag", run), marked, mapping(tmp_path / "map.xml", run.robots))
    unjudged = [one for one in drive.summary.verdicts if not one.judged]
    assert {one.robot for one in unjudged} == set(run.robots)
    assert all(one.detail == "the recording has no cos_bearing of " + one.robot for one in unjudged)
    assert not any(one.passed or one.as_marked for one in unjudged)


@pytest.mark.parametrize("fault", [math.nan, math.inf])
def test_samples_that_are_no_numbers(run: Result, line: Scenario, tmp_path: Path, fault: float) -> None:
    cosim.export_result(run, tmp_path / "a.csv")
    lines = (tmp_path / "a.csv").read_text().splitlines()
    at = lines[0].split(",").index("follower_1.pose.x [m]")
    for k in (10, 11):
        cells = lines[k].split(",")
        cells[at] = str(fault)
        lines[k] = ",".join(cells)
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    drive = judge_drive(tmp_path / "a.csv", line)
    assert np.isfinite(drive.drive.result["pose"].values).all()
    assert drive.summary.notes[-1] == "a.csv: 2 samples of pose x of follower_1 are no numbers and are left out"
    assert drive.drive.tracked[1].bridged == 2


def changed(path: Path, change: Callable[[list[str]], list[str]], end: str = "\n") -> Path:
    path.write_text("\n".join(change(path.read_text().splitlines())) + end)
    return path


@pytest.mark.parametrize(
    ("change", "end", "said"),
    [
        (lambda lines: [*lines[:20], *lines[30:40], *lines[20:30], *lines[40:]], "\n", None),
        (lambda lines: [*lines, *lines[1:]], "\n", r"the time of pose x of leader goes back by 1 s to 0 s"),
        (lambda lines: [*lines[:10], "0.3,abc" + "," * 500, *lines[10:]], "\n", "the row has"),
        (lambda lines: [*lines[:10], re.sub(r",[^,]*", ",abc", lines[10], count=1), *lines[11:]], "\n", "a.csv:11"),
        (lambda lines: [lines[0].replace("follower_1.pose.x [m]", "follower_1.pose.x [deg]"), *lines[1:]], "\n",
         r"the column 'follower_1.pose.x' of .*a.csv is in deg, but pose x of follower_1 needs a unit such as m"),
        (lambda lines: [lines[0].replace("follower_1.pose.x [m]", "follower_1.pose.x"), *lines[1:]], "\n",
         "has no unit, but pose x of follower_1 needs a unit such as m"),
        (lambda lines: [lines[0].replace("follower_1.pose.x [m]", "follower_1.pose.x [furlong]"), *lines[1:]], "\n",
         "furlong"),
        (lambda lines: [lines[0].replace("time [s]", "t [s]"), *lines[1:]], "\n", "names no column 'time'"),
        (lambda lines: [lines[0].replace("time [s]", "time [m]"), *lines[1:]], "\n", "is in m, which is no time"),
        (lambda lines: [lines[0].replace("leader.pose.y", "leader.pose.x"), *lines[1:]], "\n", "two columns named"),
        (lambda lines: lines[:1], "\n", "has no rows"),
        (lambda lines: [lines[0].replace("pose", "place"), *lines[1:]], "\n", "no pose of any follower"),
        (lambda lines: ["hello"], "\n", "is no table"),
    ],
)  # fmt: skip
def test_tables_with_faults(
    run: Result,
    line: Scenario,
    tmp_path: Path,
    change: Callable[[list[str]], list[str]],
    end: str,
    said: str | None,
) -> None:
    cosim.export_result(run, tmp_path / "a.csv")
    changed(tmp_path / "a.csv", change, end)
    if said is None:
        drive = judge_drive(tmp_path / "a.csv", line)
        close(drive.drive.result, run)
        assert any("were not in the order of time" in note for note in drive.summary.notes)
        return
    with pytest.raises(InputError, match=said):
        judge_drive(tmp_path / "a.csv", line)


def test_a_table_that_is_cut_off(run: Result, line: Scenario, tmp_path: Path) -> None:
    cosim.export_result(run, tmp_path / "a.csv")
    data = (tmp_path / "a.csv").read_bytes()
    (tmp_path / "a.csv").write_bytes(data[: data.rindex(b"\n", 0, -1) + 30])
    drive = judge_drive(tmp_path / "a.csv", line)
    assert [(one.samples, one.bridged, one.missing) for one in drive.drive.tracked] == [
        (50, 0, 0),
        *[(50, 0, 1)] * 4,
    ]  # x, y
    assert drive.summary.notes[0].startswith("a.csv: the last line has no line end, so its last number may be cut off")


@pytest.mark.parametrize("last", ["follower_1.pose.gamma [rad]", "follower_1.range_error [m]"])
def test_a_last_line_without_a_line_end_lacks_its_last_cell(
    run: Result, line: Scenario, tmp_path: Path, last: str
) -> None:
    """The number before never stands for it: an expectation that needs it is not judged."""
    cosim.export_result(run, tmp_path / "a.csv")
    rows = [row.split(",") for row in (tmp_path / "a.csv").read_text().splitlines()]
    at = rows[0].index(last)
    text = "\n".join(",".join([*row[:at], *row[at + 1 :], row[at]]) for row in rows)
    (tmp_path / "last.xml").write_text(
        re.sub(
            r"(?s)<expect>.*</expect>",
            '<expect><peak signal="pose" component="gamma" below="80 deg" robots="follower_1"/></expect>',
            line.text,
        )
    )
    judges = read_scenario(tmp_path / "last.xml")
    (tmp_path / "a.csv").write_text(text + "\n")
    whole = judge_drive(tmp_path / "a.csv", judges)
    assert (whole.summary.passed, whole.summary.notes) == (True, ())
    (tmp_path / "a.csv").write_text(text)
    drive = judge_drive(tmp_path / "a.csv", judges)
    if "gamma" not in last:  # a column that is not needed
        assert verdicts(drive.drive.result) == verdicts(whole.drive.result)
        assert drive.summary.notes == ()
        return
    pose = drive.drive.result["pose"].values
    assert np.argwhere(np.isnan(pose)).tolist() == [[50, 0, 3]]
    [found] = drive.summary.verdicts
    assert found.detail == "the recording has no gamma of the pose of follower_1 at 1 of 51 ticks, 1 to 1 s"
    assert [note[7:30] for note in drive.summary.notes] == ["the last line has no li", "1 samples of pose gamma"]


def test_rows_without_a_time_are_told(run: Result, line: Scenario, tmp_path: Path) -> None:
    cosim.export_result(run, tmp_path / "a.csv")
    changed(tmp_path / "a.csv", lambda rows: [*rows[:20], re.sub(r"^[^,]*", "", rows[20]), *rows[21:]])
    assert judge_drive(tmp_path / "a.csv", line).summary.notes[0] == "a.csv: 1 rows have no time and are left out"


def test_a_table_of_others(run: Result, line: Scenario, tmp_path: Path) -> None:
    text = "stamp [ms],bx [cm],by [mm],bh\n" + "".join(
        f"{1e6 + 20 * k},{100 * x},{1000 * y},{90 - math.degrees(psi)}\n"
        for k, (x, y, psi, _) in enumerate(run.of_robot("pose", "follower_1"))
    )
    (tmp_path / "a.csv").write_text(text)
    (tmp_path / "map.xml").write_text(
        f'<mapping xmlns="{NAMESPACE}" time="stamp"><robot id="follower_1">'
        '<signal name="pose" component="x" column="bx"/><signal name="pose" component="y" column="by"/>'
        '<signal name="pose" component="psi" column="bh" unit="deg" factor="-1" offset="90 deg"/></robot></mapping>'
    )
    drive = judge_drive(tmp_path / "a.csv", line, tmp_path / "map.xml")
    assert drive.drive.start == 1000 * 10**9
    np.testing.assert_allclose(
        drive.drive.result["pose"].values[:, 0, :3], run.of_robot("pose", "follower_1")[:, :3], atol=1e-9
    )
    assert [one.missing for one in drive.drive.tracked] == [51, 0, 51, 51, 51]
    assert not any(one.judged for one in drive.summary.verdicts)


@pytest.mark.parametrize(
    ("mapped", "said"),
    [
        ('<robot id="robot_9" topic="/r1/where"/>', "map.xml:1:.*robot_9"),
        ('<robot id="leader" topic="/r1/wher"/>', "has no topic '/r1/wher': did you mean '/r1/where'"),
        ('<robot id="leader" topic="/r1/joints"/>', "have no pose in the plane; their fields: header, name, position"),
        ('<robot id="leader"><signal name="pose" component="x" topic="/r1/where" field="pose.x"/></robot>',
         "messages of type nav_msgs/msg/Odometry, which have no number 'pose.x'; their fields: header, child_frame_id"),
        ('<robot id="leader"><signal name="pose" component="x" topic="/r1/where"/></robot>', "no number 'data'"),
        ('<robot id="leader"><signal name="pose" component="x" topic="/r1/where" field="a..b"/></robot>', "'a..b'"),
        ('<robot id="leader"><signal name="pose" component="x" column="x"/></robot>', "has topics and no columns"),
        ('<robot id="leader"><signal name="pose" component="x"/></robot>', "either a column of a table or a topic"),
        ('<robot id="leader"><signal name="pose" component="z" topic="/r1/where"/></robot>',
         "'pose' has no component 'z', but x, y, psi, gamma"),
        ('<robot id="follower_1"><signal name="range_error" topic="/r1/where"/></robot>',
         "no signal 'range_error' can be mapped; it is computed from poses; those that can: "),
        ('<robot id="leader" from="scenario" topic="/r1/where"/>', 'from="scenario" is for a leader'),
        ('<robot id="follower_1" from="scenario"/>', 'from="scenario" is for a leader'),
        ('<robot id="leader" ahead="1 m"/>', "belong to a topic"),
        ('<robot id="leader" topic="/r1/where"/><robot id="leader" topic="/r2/where"/>', "mapped twice"),
        ('<robot id="follower_1"><signal name="pose" component="x" topic="/r1/joints" field="position[0]" unit="deg"/>'
         "</robot>",
         "is in deg, but pose x of follower_1 needs a unit such as m"),
        ('<robot id="leader" topic="/r1/joints" child_frame="base"/>',
         "messages of type sensor_msgs/msg/JointState, which name no child_frame: leave it out"),
        ('<robot id="leader"><signal name="pose" component="gamma" topic="/r1/joints" field="position[1]" '
         'child_frame="base"/></robot>', "map.xml:1:.*, which name no child_frame: leave it out"),
        ('<robot id="leader" topic="/r1/where" child_frame="bas"/>',
         "map.xml:1:.* the topic '/r1/where' of .* has no frame 'bas': did you mean 'base'"),
        ('<robot id="leader"><signal name="pose" component="x" topic="/a" unit="furlong"/></robot>', "furlong"),
        ('<robot id="leader"><signal name="pose" component="x" topic="/a" factor="0"/></robot>', "makes every value"),
    ],
)  # fmt: skip
def test_mappings_with_faults(
    run: Result, line: Scenario, tmp_path_factory: pytest.TempPathFactory, tmp_path: Path, mapped: str, said: str
) -> None:
    shared = tmp_path_factory.getbasetemp() / "bag_of_faults"
    if not shared.exists():
        bag(shared, run)
    (tmp_path / "map.xml").write_text(f'<mapping xmlns="{NAMESPACE}">{mapped}</mapping>')
    with pytest.raises(InputError, match=said):
        judge_drive(shared, line, tmp_path / "map.xml")


@pytest.mark.parametrize(
    ("stated", "recording", "said"),
    [
        ('time="stamp"', "bag", "names a column of a table, and .*bag is a bag: leave it out"),
        ('time="time"', "result.nc", "names a column of a table, and .*nc is the result of a run: leave it out"),
        ('clock="log"', "result.nc", "chooses a time of messages, and .*nc is the result of a run: leave it out"),
        ('clock="header"', "a.csv", "chooses a time of messages, and .*csv is a table: leave it out"),
    ],
)
def test_a_time_of_another_kind_of_recording(
    run: Result, line: Scenario, tmp_path: Path, stated: str, recording: str, said: str
) -> None:
    if recording == "bag":
        bag(tmp_path / "bag", run)
    (tmp_path / "a.csv").write_text("time,x\n0,0\n")
    save(run, tmp_path / "result.nc")
    (tmp_path / "map.xml").write_text(f'<mapping xmlns="{NAMESPACE}" {stated}/>')
    with pytest.raises(InputError, match=rf"map\.xml:1:\d+: {stated} of <mapping> {said}"):
        judge_drive(tmp_path / recording, line, tmp_path / "map.xml")


def test_a_topic_is_no_column_without_a_name(line: Scenario, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(",time\n0,0\n1,1\n")
    mapped = '<signal name="pose" component="x" topic="/a" unit="m"/>'
    (tmp_path / "map.xml").write_text(f'<mapping xmlns="{NAMESPACE}"><robot id="leader">{mapped}</robot></mapping>')
    with pytest.raises(InputError, match="is a table, which has columns and no topics: name a column"):
        judge_drive(tmp_path / "a.csv", line, tmp_path / "map.xml")


@pytest.mark.parametrize("start", ["noon", "nan", "1 m"])
def test_a_start_that_is_no_time(line: Scenario, tmp_path: Path, start: str) -> None:
    (tmp_path / "map.xml").write_text(f'<mapping xmlns="{NAMESPACE}" start="{start}"/>')
    (tmp_path / "a.csv").write_text("time,x\n0,0\n")
    with pytest.raises(InputError, match="expected seconds such as"):
        judge_drive(tmp_path / "a.csv", line, tmp_path / "map.xml")


def test_a_start_outside_of_the_recording(run: Result, line: Scenario, tmp_path: Path) -> None:
    cosim.export_result(run, tmp_path / "a.csv")
    with pytest.raises(InputError, match=r"from 0 s to 1 s, and the scenario would begin at its 1777887000 s"):
        judge_drive(tmp_path / "a.csv", line, start=1_777_887_000.0)


def test_bags_with_faults(run: Result, line: Scenario, tmp_path: Path) -> None:
    cosim.export_result(run, tmp_path / "whole.mcap")
    data = (tmp_path / "whole.mcap").read_bytes()
    broken = bytearray(data)
    at = data.index(b"\x28\xb5\x2f\xfd") + 1000  # in a compressed chunk
    broken[at : at + 20] = bytes(20)
    no_messages = tmp_path / "empty"
    with Writer(no_messages, version=9):
        pass
    cases = {
        "cut.mcap": data[: len(data) // 2],
        "head.mcap": data[:20],
        "empty.mcap": b"",
        "other.mcap": b"PK\x03\x04" + bytes(100),
        "broken.mcap": bytes(broken),
        "other.db3": b"SQLite format 3\0" + bytes(100),
        "ros1.bag": b"#ROSBAG V2.0\n",
    }
    for name, content in cases.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=f"{name} cannot be read as a bag: "):
            judge_drive(tmp_path / name, line)
    with pytest.raises(InputError, match="no pose of any follower"):
        judge_drive(no_messages, line)
    for text in ("", "a: [", "rosbag2_bagfile_information: 3", "!!python/object/apply:os.system [ls]"):
        (no_messages / "metadata.yaml").write_text(text)
        with pytest.raises(InputError, match="cannot be read as a bag: "):
            judge_drive(no_messages, line)


def test_a_small_file_that_unpacks_to_more_than_is_allowed(
    line: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bags, "MOST_MEMORY", 1 << 26)
    before = resource.getrlimit(resource.RLIMIT_AS)
    path = tmp_path / "bomb.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file, compression=CompressionType.ZSTD)
        writer.start(profile="ros2")
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
        channel = writer.register_channel("/leader/signals/pose/x", "cdr", schema)
        writer.add_message(channel, log_time=0, publish_time=0, data=b"\0\1\0\0" + bytes(1 << 27))
        writer.finish()
    assert path.stat().st_size < 1 << 20
    gc.collect()  # what other tests have left would be room for it
    with pytest.raises(InputError, match=r"unpacked it needs more than 0\.0625 GiB"):
        judge_drive(path, line)
    assert resource.getrlimit(resource.RLIMIT_AS) == before


def test_mutated_recordings(run: Result, line: Scenario, tmp_path: Path) -> None:
    """Whatever stands in a file: it is judged or refused with a sentence."""
    cosim.export_result(run, tmp_path / "a.mcap")
    cosim.export_result(run, tmp_path / "a.csv")
    mapped = mapping(tmp_path / "map.xml", run.robots)
    (database,) = bag(tmp_path / "db", run).glob("*.db3")
    (other,) = bag(tmp_path / "other", run, storage=StoragePlugin.MCAP).glob("*.mcap")
    random = Random(1)
    refused: list[str] = []
    for _ in range(40):
        file, map_file = random.choice(
            [(tmp_path / "a.mcap", None), (tmp_path / "a.csv", None), (database, mapped), (other, mapped)]
        )
        data = bytearray(file.read_bytes())
        for _ in range(random.choice([1, 2, 10])):
            at = random.randrange(min(3000, len(data)) if random.random() < 0.5 else len(data))
            if random.random() < 0.5:
                data[at : at + random.randrange(20)] = random.randbytes(random.randrange(20))
            else:
                data[at : at + 8] = random.choice([b"\xff" * 8, bytes(8), b"nan,inf,", b""])
        (mutated := tmp_path / f"m{file.suffix}").write_bytes(data)
        try:
            judge_drive(mutated, line, map_file)
        except InputError as error:
            refused.append(str(error))
    assert 20 < len(refused) < 40
    assert not any("\n" in sentence for sentence in refused)


def test_other_files(line: Scenario, tmp_path: Path) -> None:
    for name, content, said in (
        ("a.csv", b"\xff\xfe\x00a", "not text in UTF-8"),
        ("a.csv", b"\x89PNG\r\n\x1a\n" + bytes(50), "not text in UTF-8"),
        ("a.csv", b"a,b\0\n1,2\n", "is no table"),
        ("a.nc", b"CDF", "no netCDF file"),
        ("a.txt", b"\n", "is no table"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=said):
            judge_drive(tmp_path / name, line)
    with pytest.raises(InputError, match=r"there is no such file: did you mean .*a\.csv"):
        judge_drive(tmp_path / "A.csv", line)
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match=r"is a folder without metadata\.yaml"):
        judge_drive(tmp_path / "folder", line)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="POSIX pipes")
def test_a_pipe(line: Scenario, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.mcap")
    with pytest.raises(InputError, match=r"pipe\.mcap is not a regular file"):
        judge_drive(tmp_path / "pipe.mcap", line)


def test_a_missing_package(line: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.mcap").write_bytes(b"")
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(InputError, match=r"rosbags; install it: python -m pip install 'formation-cosim\[export\]'"):
        judge_drive(tmp_path / "a.mcap", line)


# At the ticks -----------------------------------------------------------------------------------------------


@given(
    st.lists(st.tuples(st.floats(0, 10), st.floats(-5, 5)), min_size=2, max_size=15, unique_by=lambda pair: pair[0]),
    st.floats(0.05, 3.0),
)
def test_between_samples_there_is_a_straight_line(pairs: list[tuple[float, float]], longest: float) -> None:
    time, values = np.array(sorted(pairs)).T
    ticks = np.linspace(0.0, 10.0, 41)
    found = sampled(time, values, ticks, longest).values
    expected = np.interp(ticks, time, values)
    for tick, value, straight in zip(ticks, found, expected, strict=True):
        after = int(np.searchsorted(time, tick - 1e-9))
        beyond = max(time[0] - tick, tick - time[-1])
        outside = beyond > 1e-9
        if outside and beyond <= min(longest, float(np.median(np.diff(time)))) + 1e-9:
            assert value == (values[0] if tick < time[0] else values[-1])
            continue
        on = not outside and abs(time[after] - tick) <= 1e-9
        gap = not outside and not on and time[after] - time[after - 1] > longest + 1e-9
        assert math.isnan(value) == (outside or gap)
        if not math.isnan(value):
            assert value == (values[after] if on else pytest.approx(straight, abs=1e-6))


def test_angles_turn_the_shortest_way() -> None:
    time, ticks = np.arange(5.0), np.arange(0.0, 4.5, 0.5)
    found = sampled(time, np.array([3.0, -3.0, 3.0, -2.0, -1.0]), ticks, 2.0, angle=True).values
    turn = 2 * np.pi
    np.testing.assert_allclose(found[[0, 2, 4, 6, 8]], [3.0, turn - 3.0, 3.0, turn - 2.0, turn - 1.0])
    np.testing.assert_allclose(found[1], np.pi)


@pytest.mark.parametrize("fault", [math.nan, math.inf, -math.inf])
def test_no_value_is_made_of_samples_that_are_no_numbers(fault: float) -> None:
    time, ticks = np.arange(5.0), np.arange(0.0, 6.5, 0.5)
    assert sampled(time, np.array([0.0, 1.0, fault, 3.0, 4.0]), ticks, 2.0).values[:9].tolist() == ticks[:9].tolist()
    found = sampled(time, np.array([fault, 1.0, 2.0, 3.0, fault]), ticks, 2.0)
    assert np.isnan(found.values).tolist() == [True] * 2 + [False] * 5 + [True] * 6
    assert (found.not_numbers, found.samples, found.bridged) == (2, 3, 0)


@pytest.mark.parametrize(("every", "first"), [(2, 0), (2, 1), (5, 2), (10, 3), (10, 9)])
def test_a_column_that_has_numbers_in_some_rows_alone_is_held_at_its_ends(every: int, first: int) -> None:
    """As in a table of several topics, of which each has rows of its own."""
    time = np.arange(1001) * 0.01
    column = np.where(np.arange(1001) % every == first, time, math.nan)
    assert np.isfinite(sampled(time, column, time, 0.5).values).all()
    column[-every:] = math.nan  # one more number is missing, as after a cut
    assert np.isnan(sampled(time, column, time, 0.5).values[-1])


def test_a_clock_that_goes_back() -> None:
    values = np.zeros(4)
    with pytest.raises(ClockGoesBack) as caught:
        sampled(np.array([0.0, 5.0, 1.0, 6.0]), values, np.arange(3.0), 0.5)
    assert (caught.value.time, caught.value.by) == (1.0, 4.0)
    assert sampled(np.array([0.0, 0.3, 0.2, 0.2]), np.arange(4.0), np.array([0.0, 0.2]), 0.5).values[1] == 3.0


# The command ------------------------------------------------------------------------------------------------


def test_the_command(
    run: Result, line: Scenario, scenarios: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "line.xml"
    own.write_text(line.text, encoding="utf-8")
    recording = bag(tmp_path / "bag", run)
    map_file = mapping(tmp_path / "map.xml", run.robots)
    options = ["--scenario", str(own), "--map", str(map_file), "--junit", str(tmp_path / "j.xml")]
    assert main(["judge", str(recording), *options, "--out", str(tmp_path / "out")]) == 1
    printed = capsys.readouterr().out
    assert "the scenario begins at its 1777887000 s" in printed
    assert re.search(r"follower_4 +51 +0\.02 +0 +0 *\n", printed)
    assert "not judged  regular, 0 to 1 s: no figure (follower_1; the recording has no cos_bearing" in printed
    assert "FAILS  settled by 0.5 s" in printed
    folder = tmp_path / "out" / line.name
    assert sorted(path.name for path in folder.iterdir()) == ["report.html", "result.nc", "summary.json"]
    summary = json.loads((folder / "summary.json").read_text())
    assert not summary["passed"]
    assert [one["judged"] for one in summary["verdicts"] if one["expectation"].startswith("regular")] == [False] * 4
    suite = etree.parse(tmp_path / "j.xml").getroot()[0]
    assert suite.get("errors") == "4"
    assert len(suite.findall(".//error[@type='not judged']")) == 4
    assert main(["show", str(folder)]) == 1
    shorter = ["--horizon", "0.8 s"]
    assert main(["judge", str(recording), *options, *shorter]) == 1
    assert re.search(r"follower_4 +41 +0\.02 +0 +0 *\n", capsys.readouterr().out)
    assert main(["judge", str(recording), "--scenario", str(tmp_path / "none.xml")]) == 2
    assert main(["judge", str(recording), "--scenario", str(own), "--start", "noon"]) == 2
    assert "the start noon is none: expected the time in the recording" in capsys.readouterr().err


def test_a_drive_that_holds(run: Result, line: Scenario, tmp_path: Path) -> None:
    own = tmp_path / "line.xml"
    text = re.sub(r"(?s)<expect>.*</expect>", '<expect><peak signal="range_error" below="90 m"/></expect>', line.text)
    own.write_text(text, encoding="utf-8")
    map_file = mapping(tmp_path / "map.xml", run.robots)
    recording = bag(tmp_path / "bag", run)
    assert main(["judge", str(recording), "--scenario", str(own), "--map", str(map_file)]) == 0
