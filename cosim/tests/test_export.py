"""Results as files of other tools, read back by libraries that have not written them."""

from __future__ import annotations

import io
import json
import re
import sys
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.io import loadmat

import cosim
from cosim.cli import main
from cosim.errors import Failure, InputError, Location, OutputError
from cosim.export import ros2_types
from cosim.export.courses import courses_of
from cosim.export.formats import FORMATS
from cosim.export.mat import matlab_name
from cosim.export.ros2_names import token, tokens
from cosim.results.files import save
from cosim.results.outlines import outlined_followers
from cosim.results.result import Result, Variable
from cosim.scenario.csv_table import read_table
from cosim.vehicle.outline import placed

HERE = Location("test")
TOPICS_OF_A_ROBOT = {"odom", "pose", "measured_pose", "path"}


@pytest.fixture(scope="module")
def mixed(scenarios: Path) -> Result:
    """The start of a run of car-like robots and tractor-trailers, in which something happens."""
    result = Result.of(cosim.run(scenarios / "mixed_team.xml", horizon=1.0, expectations=False))
    event = '<event at="0.3 s" robots="car_1"><parameter name="m_c" value="40 kg"/></event>'
    text = re.sub("(?=<expect>)|(?=</scenario>)", event, result.attrs["scenario"], count=1)
    failure = json.dumps(asdict(Failure("car_1", 1.0, "", "out of fuel")))
    messages = {"time": [0.5, 0.5], "count": [3, 1], "robot": ["truck_1", "car_1"], "status": ["Warning", "Error"]}
    messages |= {"category": ["", ""], "text": ["low oil, \N{SNOWMAN}", "no such \x1bgear"]}
    told = {f"message_{name}": Variable(("message",), np.array(values)) for name, values in messages.items()}
    return Result(result.data_vars, {**result.coords, **told}, {**result.attrs, "scenario": text, "failure": failure})


@dataclass(frozen=True)
class Recording:
    """An exported file, as a library has read it: messages with their times [ns] by topic, and the topics' metadata."""

    file: Path
    messages: Mapping[str, list[tuple[int, Any]]]
    about: Mapping[str, Mapping[str, str]]

    def numbers(self, topic: str) -> np.ndarray[Any, Any]:
        return np.array([message.data for _, message in self.messages[topic]])


@pytest.fixture(scope="module")
def exported(mixed: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("export") / "drive.mcap"
    cosim.export_result(mixed, path)
    return path


@pytest.fixture(scope="module")
def by_mcap(exported: Path) -> Recording:
    messages, about = defaultdict(list), {}
    with exported.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            assert message.log_time == message.publish_time
            messages[channel.topic].append((message.log_time, decoded))
            about[channel.topic] = channel.metadata
    return Recording(exported, messages, about)


@pytest.fixture(scope="module")
def by_rosbags(exported: Path) -> Recording:
    messages = defaultdict(list)
    with AnyReader([exported]) as reader:
        for connection, time, data in reader.messages():
            messages[connection.topic].append((time, reader.deserialize(data, connection.msgtype)))
    return Recording(exported, messages, {})


@pytest.fixture(params=["by_mcap", "by_rosbags"])
def recording(request: pytest.FixtureRequest) -> Recording:
    read: Recording = request.getfixturevalue(request.param)
    return read


# MCAP -------------------------------------------------------------------------------------------------------


def test_every_signal_has_a_topic_with_the_same_bits(recording: Recording, mixed: Result) -> None:
    topics = {topic for topic in recording.messages if "/signals/" in topic}
    for course in courses_of(mixed):
        topic = "/".join(["", course.robot, "signals", *course.path[1:]])
        assert recording.numbers(topic).tobytes() == course.values.tobytes()
        topics.remove(topic)
    assert not topics
    assert "/truck_1/signals/pose/theta_0" in recording.messages
    assert "/car_1/signals/pose/gamma" in recording.messages


def test_a_topic_tells_unit_and_signal(by_mcap: Recording) -> None:
    about = by_mcap.about["/truck_1/signals/pose/theta_0"]
    assert (about["robot"], about["signal"], about["component"], about["unit"]) == ("truck_1", "pose", "theta_0", "rad")
    assert by_mcap.about["/truck_1/signals/range_error"]["unit"] == "m"


def test_poses_and_odometry(recording: Recording, mixed: Result) -> None:
    pose, velocity = mixed.of_robot("pose", "truck_1"), mixed.of_robot("velocity", "truck_1")
    for topic, frame in (("/truck_1/pose", None), ("/truck_1/odom", "truck_1/base_link")):
        for k, (time, message) in enumerate(recording.messages[topic]):
            place = message.pose if frame is None else message.pose.pose
            stamp = message.header.stamp
            assert stamp.sec * 10**9 + stamp.nanosec == time == round(k * 20e6)
            assert message.header.frame_id == "map"
            assert [place.position.x, place.position.y] == pose[k, :2].tolist()
            turned = 2.0 * np.arctan2(place.orientation.z, place.orientation.w)
            assert np.cos(turned - pose[k, 2]) == pytest.approx(1.0, abs=1e-14)
            if frame is not None:
                assert message.child_frame_id == frame
                assert message.twist.twist.linear.x == velocity[k, 0]
    turning = [message.twist.twist.angular.z for _, message in recording.messages["/truck_1/odom"]]
    np.testing.assert_array_equal(turning, np.gradient(pose[:, 2], mixed["time"].values))


def test_outlines_lie_where_the_result_puts_them(recording: Recording, mixed: Result) -> None:
    [(_, markers), *_] = recording.messages["/outlines"]
    followers = outlined_followers(mixed)
    assert followers is not None
    for robot, outlined in followers.items():
        drawn = [one for one in markers.markers if one.ns == f"{robot}/outline"]
        assert len(drawn) == len(outlined.outline)
        assert all(marker.frame_locked for marker in drawn)
        expected = placed(outlined.outline, outlined.pose)
        for tick in (0, 25, 50):
            transforms = {one.child_frame_id: one for one in recording.messages["/tf"][tick][1].transforms}
            for marker, part in zip(drawn, expected, strict=True):
                corners = np.array([in_map(marker.header.frame_id, point, transforms) for point in marker.points])
                apart = np.linalg.norm(corners[:, np.newaxis] - part[tick][np.newaxis], axis=-1)
                assert apart.min(axis=1).max() < 1e-12
                assert apart.min(axis=0).max() < 1e-12


def in_map(frame: str, point: Any, transforms: Mapping[str, Any]) -> tuple[float, float]:
    x, y = point.x, point.y
    while frame != "map":
        one = transforms[frame]
        move, turn = one.transform.translation, one.transform.rotation
        angle = 2.0 * np.arctan2(turn.z, turn.w)
        x, y = (
            move.x + np.cos(angle) * x - np.sin(angle) * y,
            move.y + np.sin(angle) * x + np.cos(angle) * y,
        )
        frame = one.header.frame_id
    return x, y


def test_a_path_has_all_places(recording: Recording, mixed: Result) -> None:
    [(time, path)] = recording.messages["/leader/path"]
    assert time == 0
    found = [(pose.pose.position.x, pose.pose.position.y) for pose in path.poses]
    assert np.array(found).tobytes() == np.ascontiguousarray(mixed["leader_pose"].values[:, :2]).tobytes()
    assert [pose.header.stamp.nanosec for pose in path.poses[1:3]] == [20_000_000, 40_000_000]
    assert {pose.header.frame_id for pose in path.poses} == {"map"}


def test_the_types_are_those_of_ros(exported: Path) -> None:
    theirs = get_typestore(Stores.ROS2_HUMBLE)
    with Reader(exported) as reader:
        types = {connection.msgtype: connection.msgdef.data for connection in reader.connections}
    assert len(types) == 7
    for name, text in types.items():
        ours = get_typestore(Stores.EMPTY)
        ours.register(get_types_from_msg(text, name))
        assert ours.hash_rihs01(name) == theirs.hash_rihs01(name)


def test_what_happened_is_a_log(recording: Recording) -> None:
    found = [(time, one.level, one.name, one.msg) for time, one in recording.messages["/rosout"]]
    assert found == [
        (300_000_000, 20, "car_1", "m_c = 40 kg"),
        (500_000_000, 30, "truck_1", "low oil, \N{SNOWMAN} (3 times)"),
        (500_000_000, 40, "car_1", "no such ?gear"),
        (1_000_000_000, 50, "car_1", "car_1 at t = 1 s: out of fuel"),
    ]
    assert recording.messages["/rosout"][0][1].stamp.nanosec == 300_000_000


def test_every_type_that_is_stated_is_used() -> None:
    written = ("Log", "TFMessage", "Odometry", "PoseStamped", "MarkerArray", "Path", "Float64")
    roots = [name for name in ros2_types._FIELDS if name.rpartition("/")[2] in written]
    used = {name for root in roots for name in ros2_types._within(root)}
    assert used == set(ros2_types._FIELDS)


def test_a_reader_without_index_finds_all_in_the_order_of_time(exported: Path, mixed: Result) -> None:
    times, count = [], 0
    for record in StreamReader(io.BytesIO(exported.read_bytes()), validate_crcs=True).records:
        if type(record).__name__ == "Message":
            times.append(record.log_time)
            count += 1
    assert times == sorted(times)
    with exported.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == count
    assert (summary.statistics.message_start_time, summary.statistics.message_end_time) == (0, 1_000_000_000)


def test_the_file_tells_where_it_comes_from(exported: Path, mixed: Result) -> None:
    with exported.open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        [attachment] = reader.iter_attachments()
        [metadata] = reader.iter_metadata()
    assert (attachment.name, attachment.data.decode()) == ("scenario.xml", mixed.attrs["scenario"])
    assert metadata.metadata["scenario_name"] == "mixed_team"


def test_what_a_player_offers(exported: Path) -> None:
    with Reader(exported) as reader:
        durability = {one.topic: one.ext.offered_qos_profiles[0].durability.name for one in reader.connections}
    assert durability["/outlines"] == durability["/leader/path"] == "TRANSIENT_LOCAL"
    assert durability["/tf"] == durability["/leader/signals/pose/x"] == "VOLATILE"


def test_many_chunks(mixed: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, recording: Recording) -> None:
    monkeypatch.setattr("cosim.export.mcap._CHUNK", 1)
    monkeypatch.setattr("cosim.export.mcap._FEWEST", 1)
    monkeypatch.setattr("cosim.export.ros2_topics.MOST_POSES_OF_PATH", 20)
    cosim.export_result(mixed, tmp_path / "a.mcap", start_time=1_700_000_000.25)
    with AnyReader([tmp_path / "a.mcap"]) as reader:
        found = defaultdict(list)
        for connection, time, data in reader.messages():
            found[connection.topic].append((time, reader.deserialize(data, connection.msgtype)))
    assert [time for time, _ in found["/tf"]] == [1_700_000_000_250_000_000 + 20_000_000 * k for k in range(51)]
    assert found["/tf"][3][1].transforms[0].header.stamp.sec == 1_700_000_000
    assert found["/tf"][3][1].transforms[0].header.stamp.nanosec == 310_000_000
    assert len(found["/outlines"]) == 51
    [(_, path)] = found["/leader/path"]
    assert [pose.header.stamp.nanosec // 20_000_000 for pose in path.poses[:3]] == [12, 15, 18]
    assert len(path.poses) == 18
    for topic in ("/truck_1/signals/range_error", "/car_1/signals/pose/x"):
        assert [message.data for _, message in found[topic]] == recording.numbers(topic).tolist()


def test_messages_are_not_written_one_by_one(mixed: Result, tmp_path: Path) -> None:
    """A library that takes them one by one needs ten times as long."""
    long = Result(
        {name: replace(one, values=np.concatenate([one.values] * 20)) for name, one in mixed.data_vars.items()},
        {**mixed.coords, "time": replace(mixed["time"], values=0.02 * np.arange(51 * 20))},
        mixed.attrs,
    )
    cosim.export_result(long, tmp_path / "a.mcap")
    with (tmp_path / "a.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None

    def ours() -> None:
        cosim.export_result(long, tmp_path / "a.mcap")

    def one_by_one() -> None:
        writer = Writer(io.BytesIO())
        writer.start("ros2")
        channel = writer.register_channel("/a", "cdr", writer.register_schema("std_msgs/msg/Float64", "ros2msg", b""))
        for k in range(summary.statistics.message_count):
            writer.add_message(channel, k, bytes(12), k)
        writer.finish()

    seconds = {work: min(cpu_seconds(work) for _ in range(2)) for work in (ours, one_by_one)}
    assert 2 * seconds[ours] < seconds[one_by_one]


def cpu_seconds(work: Callable[[], None]) -> float:
    started = process_time()
    work()
    return process_time() - started


def test_names_that_ros_does_not_take() -> None:
    assert [token(name) for name in ("front left wheel", "a.b-c", "1st", "a__b_", "Σ")] == [
        "front_left_wheel",
        "a_b_c",
        "n1st",
        "a_b",
        "n",
    ]
    assert tokens(["a.b", "a-b", "a_b"]) == {"a.b": "a_b", "a-b": "a_b_2", "a_b": "a_b_3"}


@pytest.fixture
def hostile(mixed: Result) -> Result:
    """A result whose robots have names that no tool takes as they are, and one signal without a number at some time."""
    names = np.array(["=1+2", "../../etc", "a.b", "a-b"][: len(mixed.robots)])
    vehicles = np.array(["leader", *names])
    error = mixed["range_error"].values.copy()
    error[3, 0] = np.nan
    return Result(
        {**mixed.data_vars, "range_error": replace(mixed["range_error"], values=error)},
        {**mixed.coords, "robot": Variable(("robot",), names), "vehicle": Variable(("vehicle",), vehicles)},
        {**mixed.attrs, "title": "<b>\x1b[31m", "scenario_name": "x" * 300},
    )


def test_hostile_names(hostile: Result, tmp_path: Path) -> None:
    cosim.export_result(hostile, tmp_path / "a.mcap")
    with AnyReader([tmp_path / "a.mcap"]) as reader:
        topics = {connection.topic for connection in reader.connections}
    assert all(re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)+", topic) and "__" not in topic for topic in topics)
    assert {"/n1_2/odom", "/etc/odom", "/a_b/odom"} <= topics
    cosim.export_result(hostile, tmp_path / "a.mat")
    assert "x_1_2" in loadmat(tmp_path / "a.mat", simplify_cells=True)


# CSV and MATLAB ---------------------------------------------------------------------------------------------


def test_a_table_reads_back_as_scenarios_read_it(mixed: Result, tmp_path: Path) -> None:
    cosim.export_result(mixed, tmp_path / "a.csv")
    table = read_table(tmp_path / "a.csv", HERE)
    courses = list(courses_of(mixed))
    assert len(table.columns) == len(courses) + 1
    assert table.time.tobytes() == mixed["time"].values.tobytes()
    for course in courses:
        name = ".".join(course.path)
        assert table.columns[name] == course.unit
        assert table.column(name, course.unit, HERE).tobytes() == course.values.tobytes()


def test_a_number_that_is_not_there_is_an_empty_cell(hostile: Result, tmp_path: Path) -> None:
    cosim.export_result(hostile, tmp_path / "a.csv")
    heads, *rows = [line.split(",") for line in (tmp_path / "a.csv").read_text().splitlines()]
    at = next(k for k, head in enumerate(heads) if head == "_1_2.range_error [m]")
    assert [row[at] == "" for row in rows[:5]] == [False, False, False, True, False]


def test_matlab(mixed: Result, tmp_path: Path) -> None:
    cosim.export_result(mixed, tmp_path / "a.mat")
    read = loadmat(tmp_path / "a.mat", simplify_cells=True)
    assert read["time"].tobytes() == mixed["time"].values.tobytes()
    for course in courses_of(mixed):
        values, unit = read, read["units"]
        for name in course.path:
            values, unit = values[name], unit[name]
        assert values.tobytes() == course.values.tobytes()
        assert unit == course.unit
    assert read["about"]["scenario_name"] == "mixed_team"
    assert loadmat(tmp_path / "a.mat")["time"].shape == (51, 1)


def test_names_that_matlab_does_not_take() -> None:
    names = ["for", "1st", "_a", "a.b", "Σ", "x" * 80]
    assert [matlab_name(name) for name in names] == ["x_for", "x_1st", "a", "a_b", "x_", "x" * 63]


# The command and its refusals -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def run_folder(mixed: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    save(mixed, folder / "result.nc")
    return folder


def test_the_command(run_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], exported: Path) -> None:
    assert main(["export", str(run_folder)]) == 0
    assert "result.mcap" in capsys.readouterr().out
    assert (run_folder / "result.mcap").read_bytes() == exported.read_bytes()
    files = [tmp_path / "a.csv", tmp_path / "a.MAT", tmp_path / "a.mcap"]
    start = ["--start-time", "2026-05-04T09:30:00Z"]
    assert main(["export", str(run_folder / "result.nc"), *(f"--out={file}" for file in files), *start]) == 0
    assert all(file.exists() for file in files)
    with Reader(files[2]) as reader:
        assert reader.start_time == 1_777_887_000 * 10**9


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--out=a.xlsx"], r"a\.xlsx: the ending of the name states the format, one of these: \.mcap: ROS 2"),
        (["--out=a"], "the ending of the name states the format"),
        (["--out=/proc/x/a.csv"], "cannot be written"),
        (
            ["--start-time=noon"],
            "the start time noon is none: expected a date with a time, such as 2026-05",
        ),
        (["--start-time=nan"], "expected a date"),
        (["--start-time=-1"], "from 1970 to 2038"),
        (["--start-time=1e300"], "expected a date"),
        (["--start-time=2099-01-01"], "from 1970 to 2038"),
        (["--out=a.csv", "--start-time=0"], "--start-time is about .mcap: add --out FILE.mcap, or leave it out"),
        (["--out=a.csv", "--from", "1 s"], "--from is about moving pictures: add --out FILE.gif, .png or .mp4, or "),
        (["--out=a.mat", "--to=2 s"], "--to is about moving pictures"),
        (["--speed=3"], "--speed is about moving pictures"),
        (["--out=a.csv", "--out=b.mcap", "--fps=20"], "--fps is about moving pictures"),
        (["--out=a.csv", "--size=800x450"], "--size is about moving pictures"),
        (["--out=a.csv", "--ssp-version=1.0"], "--ssp-version is about an SSP: add --ssp FILE.ssp, or leave it out"),
        (["--fmu=a.fmu", "--ssp-version=2.0"], "--ssp-version is about an SSP"),
        (["--ssp=a.ssp", "--fps=20"], "--fps is about a result, and --ssp and --fmu write a scenario"),
        (["--fmu=a.fmu", "--start-time=0"], "--start-time is about a result"),
        (["--ssp=a.ssp", "--out=a.csv"], "--out is about a result"),
    ],
)
def test_bad_options(
    run_folder: Path,
    options: list[str],
    said: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["export", str(run_folder), *options]) == 2
    printed = capsys.readouterr().err
    assert re.search(said, printed), printed
    assert "Traceback" not in printed
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_no_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import xarray as xr

    xr.Dataset({"a": ("x", [1.0])}).to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
    assert main(["export", str(tmp_path / "other.nc"), "--out", str(tmp_path / "a.csv")]) == 2
    assert "other.nc: this is not the result of a run: 'scenario_name' is missing in it" in capsys.readouterr().err
    (tmp_path / "cut.nc").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    assert main(["export", str(tmp_path / "cut.nc"), "--out", str(tmp_path / "a.csv")]) == 2
    assert "cut.nc cannot be read as the result of a run" in capsys.readouterr().err
    assert not (tmp_path / "a.csv").exists()


def test_a_run_without_a_sample(mixed: Result, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no sample"):
        cosim.export_result(mixed.within(slice(0)), tmp_path / "a.csv")


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".mcap"])
def test_a_run_that_failed_at_its_start(mixed: Result, tmp_path: Path, suffix: str) -> None:
    cosim.export_result(mixed.within(slice(1)), tmp_path / f"a{suffix}")
    assert (tmp_path / f"a{suffix}").stat().st_size > 1000


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".mcap"])
def test_a_result_of_an_earlier_version(mixed: Result, tmp_path: Path, suffix: str) -> None:
    """It has no outlines, and no names of its own for the entries of each vehicle."""
    described = re.compile("vehicle.*|outline.*|.*_(name|meaning|units)|plant.*|message.*")
    earlier = replace(mixed, coords={name: one for name, one in mixed.coords.items() if not described.fullmatch(name)})
    cosim.export_result(earlier, tmp_path / f"a{suffix}")
    if suffix == ".mcap":
        with AnyReader([tmp_path / "a.mcap"]) as reader:
            topics = {connection.topic for connection in reader.connections}
        assert {"/truck_1/odom", "/truck_1/signals/pose/psi_theta_1"} <= topics


@pytest.mark.parametrize("suffix", sorted(FORMATS.keys() - {".mp4"}))
def test_a_file_that_cannot_be_written_leaves_the_one_before(mixed: Result, tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"a{suffix}").mkdir()
    with pytest.raises(OutputError, match="cannot be written"):
        cosim.export_result(mixed, tmp_path / f"a{suffix}")
    assert [path.name for path in tmp_path.iterdir()] == [f"a{suffix}"]


def test_a_missing_package(mixed: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "zstandard", None)
    with pytest.raises(InputError, match=r"zstandard; install it: python -m pip install 'formation-cosim\[export\]'"):
        cosim.export_result(mixed, tmp_path / "a.mcap")


def test_more_signals_than_topics(mixed: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cosim.export.mcap.MOST_CHANNELS", 100)
    with pytest.raises(InputError, match="but an MCAP file 100 topics at most"):
        cosim.export_result(mixed, tmp_path / "a.mcap")
