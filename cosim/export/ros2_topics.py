"""The topics of a run in ROS 2: which there are, and their messages."""

from __future__ import annotations

import colorsys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.clock import ROUNDING
from cosim.export.cdr import Floats, Message, Turn
from cosim.export.courses import courses_of
from cosim.export.log import Entry, log_of
from cosim.export.robots import Robot, Shape, robots_of
from cosim.export.ros2_names import signal_topic, tokens
from cosim.results.result import Result

MAP, BASE = "map", "base_link"
"""Frames: that of the ground, and that of a robot, after its name."""
MOST_POSES_OF_PATH = 10_000
"""Poses of a path; those of a longer run are every second, every third, ... one."""
_OPAQUE = 0.6
_HEIGHT = {False: 0.0, True: 0.02}
"""Height [m] at which bodies and wheels are drawn, so that wheels are seen on the body."""
_TYRE = (0.1, 0.1, 0.1)
_LEADER = (0.45, 0.45, 0.45)

Stamps: TypeAlias = NDArray[np.uint64]
"""Times as messages hold them: seconds in the lower half, nanoseconds in the upper one."""


@dataclass(frozen=True, eq=False)
class Topic:
    """A topic with a message at every tick.

    Attributes
    ----------
    name, type : str
        Its name, and the type of its messages.
    message : Message
        The messages.
    about : dict
        Whatever else is known of it.
    """

    name: str
    type: str
    message: Message = field(repr=False)
    about: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Occasional:
    """A topic with a few messages.

    Attributes
    ----------
    name, type : str
        Its name, and the type of its messages.
    messages : callable
        Makes the messages from the stamps of all ticks, each with its tick, in the order of ticks.
    latched : bool
        Whether a player keeps the last one for whoever comes later.
    repeated : bool
        Whether the first one is repeated in the course of the run.
    """

    name: str
    type: str
    messages: Callable[[Stamps], list[tuple[int, bytes]]]
    latched: bool = True
    repeated: bool = False


def topics_of(result: Result) -> tuple[list[Topic], list[Occasional]]:
    """Return the topics of a run: those with a message at every tick, and the others."""
    robots = robots_of(result)
    own = tokens([robot.id for robot in robots])
    topics = [Topic("/tf", "tf2_msgs/TFMessage", _transforms(robots, own))]
    for robot in robots:
        name = own[robot.id]
        topics.append(Topic(f"/{name}/odom", "nav_msgs/Odometry", _odometry(robot, name)))
        topics.append(_pose(f"/{name}/pose", robot.x, robot.y, robot.heading))
        if robot.measured is not None:
            topics.append(_pose(f"/{name}/measured_pose", *robot.measured))
    taken = {topic.name for topic in topics}
    for course in courses_of(result):
        wanted = topic_name = signal_topic(own[course.robot], course.path[1:])
        number = 1
        while topic_name in taken:
            topic_name = f"{wanted}_{(number := number + 1)}"
        taken.add(topic_name)
        about = {
            "robot": course.robot,
            "signal": course.signal,
            "component": course.component,
            "unit": course.unit,
            "description": course.about,
        }
        about = {name: text for name, text in about.items() if text}
        topics.append(Topic(topic_name, "std_msgs/Float64", Message().number(course.values), about))
    markers = partial(_markers, robots, own)
    occasional = [Occasional("/outlines", "visualization_msgs/MarkerArray", markers, repeated=True)]
    for robot in robots:
        occasional.append(Occasional(f"/{own[robot.id]}/path", "nav_msgs/Path", partial(_path, robot)))
    if entries := log_of(result):
        ticks = np.searchsorted(result["time"].values, [entry.time - ROUNDING for entry in entries]).tolist()
        log = partial(_log, list(zip(ticks, entries, strict=True)))
        occasional.append(Occasional("/rosout", "rcl_interfaces/Log", log, latched=False))
    return topics, occasional


def _turn(angle: Floats) -> Turn:
    return np.sin(0.5 * angle), np.cos(0.5 * angle)


# At every tick ----------------------------------------------------------------------------------------------


def _transforms(robots: Sequence[Robot], own: dict[str, str]) -> Message:
    message = Message().put("I", sum(1 + len(robot.moving) for robot in robots))
    for robot in robots:
        name = own[robot.id]
        frames = _frames(robot, name)
        message.header(MAP).text(frames[""]).pose(robot.x, robot.y, _turn(robot.heading))
        for part in robot.moving:
            message.header(frames[part.on]).text(frames[part.name]).pose(*part.at, _turn(part.angle))
    return message


def _frames(robot: Robot, name: str) -> dict[str, str]:
    """Return the name of each frame of a robot."""
    parts = tokens([part.name for part in robot.moving])
    return {"": f"{name}/{BASE}", **{part: f"{name}/{own}" for part, own in parts.items()}}


def _odometry(robot: Robot, name: str) -> Message:
    message = Message().header(MAP).text(f"{name}/{BASE}")
    message.pose(robot.x, robot.y, _turn(robot.heading)).number(*[0.0] * 36)
    return message.number(robot.speed, 0.0, 0.0, 0.0, 0.0, robot.turning).number(*[0.0] * 36)


def _pose(topic: str, x: Floats, y: Floats, heading: Floats) -> Topic:
    return Topic(topic, "geometry_msgs/PoseStamped", Message().header(MAP).pose(x, y, _turn(heading)))


# Now and then -----------------------------------------------------------------------------------------------


def _markers(robots: Sequence[Robot], own: dict[str, str], stamps: Stamps) -> list[tuple[int, bytes]]:
    """Return the outlines of all robots: each part lies in its own frame, with which it moves."""
    drawn = [(place, shape) for place, robot in enumerate(robots) for shape in robot.shapes]
    message = Message().put("I", len(drawn) + len(robots))
    colours = _colours(len(robots) - 1)
    for number, (place, shape) in enumerate(drawn):
        robot = robots[place]
        frame = _frames(robot, own[robot.id])[shape.frame]
        colour, opaque = (_TYRE, 1.0) if shape.wheel else (colours[place], _OPAQUE)
        _marker(message, frame, f"{own[robot.id]}/outline", number, 11, shape, (1.0, 1.0, 1.0), (*colour, opaque))
    for number, robot in enumerate(robots):
        name = own[robot.id]
        text = (9, None, (0.0, 0.0, 0.3), (*colours[number], 1.0))
        _marker(message, f"{name}/{BASE}", f"{name}/name", number, *text, name=robot.id)
    return [(0, bytes(message.data))]


def _marker(
    message: Message,
    frame: str,
    namespace: str,
    number: int,
    kind: int,
    shape: Shape | None,
    scale: tuple[float, float, float],
    colour: tuple[float, ...],
    name: str = "",
) -> None:
    """Append a ``visualization_msgs/Marker`` that stays for good and moves with its frame."""
    message.put("I", 0, 0).text(frame).text(namespace).put("i", number, kind, 0)
    height = 0.5 if shape is None else _HEIGHT[shape.wheel]
    message.number(0.0, 0.0, height, 0.0, 0.0, 0.0, 1.0).number(*scale).put("f", *colour)
    message.put("I", 0, 0).put("B", 1)
    message.points([] if shape is None else list(_triangles(shape))).put("I", 0)
    message.text("").put("I", 0, 0).text("").text("").put("I", 0, 0)  # no texture, no coordinates of one
    message.text(name).text("").text("").put("I", 0).put("B", 0)  # no mesh


def _triangles(shape: Shape) -> Iterable[tuple[float, float]]:
    first, *others = shape.corners
    for one, other in pairwise(others):
        yield from (first, one, other)


def _colours(followers: int) -> list[tuple[float, float, float]]:
    """Return the colours of leader and followers."""
    return [_LEADER, *(colorsys.hsv_to_rgb(k / max(followers, 1), 0.75, 0.85) for k in range(followers))]


def _path(robot: Robot, stamps: Stamps) -> list[tuple[int, bytes]]:
    """Return the whole path of a robot."""
    every = -(-len(stamps) // MOST_POSES_OF_PATH)
    chosen = np.unique(np.append(np.arange(0, len(stamps), every), len(stamps) - 1))
    x, y, heading = robot.x[chosen], robot.y[chosen], robot.heading[chosen]
    w, z = np.cos(0.5 * heading), np.sin(0.5 * heading)
    message = Message().put("Q", 0).text(MAP).put("I", len(chosen))
    message.put("I", 0, 0).text(MAP).pose(float(x[0]), float(y[0]), (float(z[0]), float(w[0])))
    # From here on all poses are laid out alike, as 72 bytes are a multiple of eight.
    poses = np.zeros(len(chosen) - 1, [("stamp", "<u8"), ("length", "<u4"), ("frame", "S4"), ("pose", "<f8", 7)])
    poses["stamp"], poses["length"], poses["frame"] = stamps[chosen[1:]], len(MAP) + 1, MAP.encode()
    for place, values in ((0, x), (1, y), (5, z), (6, w)):
        poses["pose"][:, place] = values[1:]
    for place in (4, 24):  # the stamps of the path and of its first pose
        message.data[place : place + 8] = stamps[:1].tobytes()
    return [(0, bytes(message.data) + poses.tobytes())]


def _log(entries: Sequence[tuple[int, Entry]], stamps: Stamps) -> list[tuple[int, bytes]]:
    """Return what happened, each with its tick, as a ``rcl_interfaces/Log``."""
    found = []
    for tick, entry in entries:
        message = Message().put("Q", int(stamps[tick])).put("B", entry.level)
        message.text(entry.robot).text(entry.text).text("").text("").put("I", 0)  # no file, function and line
        found.append((tick, bytes(message.data)))
    return found
