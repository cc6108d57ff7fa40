"""Recordings of ROS: MCAP files, bags of ROS 2 (a folder, or a .db3 file) and of ROS 1 (.bag), by rosbags."""

from __future__ import annotations

import re
import struct
from array import array
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from cosim.errors import InputError, Location, nearest, printable
from cosim.recordings.mapping import YAW, Mapped, Place, X, Y
from cosim.recordings.memory import at_most
from cosim.recordings.series import Numbers, Series

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

MOST_MEMORY = 4 << 30
"""Bytes that reading a bag may take: a compressed part of a kilobyte may claim to be as large as it likes."""
SUFFIXES = (".mcap", ".db3", ".bag")
Message: TypeAlias = Any
Getter: TypeAlias = Callable[[Message], float]
_STEP = re.compile(r"([A-Za-z]\w*)((?:\[[0-9]{1,9}\])*)")
_FLOAT64 = "std_msgs/msg/Float64"
"""A type whose messages need no library, which a recording has most of."""


def read_bag(path: Path, wanted: Iterable[Mapped], by_header: bool) -> Numbers:
    """Return the numbers of a bag that are wanted; those that are only looked for may be missing.

    Parameters
    ----------
    path
        The file, or the folder with ``metadata.yaml``.
    wanted
        The numbers.
    by_header
        Whether the time of a message is that of its header, if it has one that is set.

    Raises
    ------
    InputError
        It is no bag or damaged, rosbags is not installed, a topic or field is missing that a mapping names, or it needs
        more than `MOST_MEMORY`, which is noticed on Linux alone.
    """
    by_topic: defaultdict[str, list[Mapped]] = defaultdict(list)
    for one in wanted:
        if not one.place.topic:
            raise InputError(f"{path} is a bag, which has topics and no columns: name a topic", one.where)
        by_topic[one.place.topic].append(one)
    with at_most(MOST_MEMORY), _opened(path) as reader:
        topics = {connection.topic for connection in reader.connections}
        for topic, those in by_topic.items():
            named = next((one for one in those if one.where is not None), None)
            if topic not in topics and named is not None:
                known = printable(nearest(topic, list(topics)))
                raise InputError(f"the recording {path} has no topic {topic!r}: {known}", named.where)
        return Numbers(_read(path, reader, by_topic, by_header), sorted(topics))


class _opened:
    """A bag, open in a block; whatever a library finds wrong in it becomes one sentence."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> AnyReader:
        try:
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        except ImportError:
            raise InputError(
                f"{self._path}: a bag needs the package rosbags; install it: "
                "python -m pip install 'formation-cosim[export]'"
            ) from None
        try:
            self._reader = AnyReader([self._path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
            self._reader.open()
        except Exception as error:  # the library and those below it raise many kinds
            raise self._refusal(error) from None
        return self._reader

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self._reader.close()
        if isinstance(error, Exception) and not isinstance(error, InputError):
            raise self._refusal(error) from None

    def _refusal(self, error: Exception) -> InputError:
        if isinstance(error, MemoryError):
            return InputError(
                f"the recording {self._path} cannot be read as a bag: unpacked it needs more than "
                f"{MOST_MEMORY / 2**30:g} GiB of memory, or than this machine has"
            )
        said = printable(str(error)).partition("\n")[0][:300]
        return InputError(f"the recording {self._path} cannot be read as a bag: {type(error).__name__}: {said}")


def _read(path: Path, reader: AnyReader, by_topic: dict[str, list[Mapped]], by_header: bool) -> dict[Place, Series]:
    times: dict[Place, array[int]] = {}
    values: dict[Place, array[float]] = {}
    getters: dict[int, list[tuple[Place, Getter]]] = {}
    connections = [connection for connection in reader.connections if connection.topic in by_topic]
    for connection in connections:
        those = by_topic[connection.topic]
        places = dict.fromkeys(one.place for one in those)
        getters[connection.id] = [(place, _getter(place)) for place in places]
        for place in places:
            times.setdefault(place, array("q"))
            values.setdefault(place, array("d"))
    plain = struct.Struct("<d").unpack_from
    bare = {
        connection.id
        for connection in connections
        if reader.is2
        and connection.msgtype == _FLOAT64
        and all(place.field in ("", "data") and not place.child_frame for place, _ in getters[connection.id])
    }
    for connection, time, data in reader.messages(connections) if connections else ():
        those_here = getters[connection.id]
        if connection.id in bare and data[1] == 1:  # little endian
            (number,) = plain(data, 4)
            for place, _ in those_here:
                times[place].append(time)
                values[place].append(number)
            continue
        message = reader.deserialize(data, connection.msgtype)
        stamp = _stamp(message) if by_header else 0
        for place, getter in those_here:
            try:
                for part in _parts(message, place.child_frame):
                    own = (_stamp(part) if by_header else 0) or stamp or time
                    number = getter(part)
                    times[place].append(own)
                    values[place].append(number)
            except (AttributeError, TypeError, ValueError) as error:
                where = next(one.where for one in by_topic[connection.topic] if one.place == place)
                raise _no_field(path, place, message, connection.msgtype, where) from error
    for place in times:
        if place.child_frame and not len(times[place]):
            _refuse_unknown_frame(path, reader, place, by_topic[place.topic])
    return {
        place: Series(np.frombuffer(times[place], np.int64).copy(), np.frombuffer(values[place]).copy())
        for place in times
    }


def _parts(message: Message, child_frame: str) -> Iterable[Message]:
    """Return the message; of a TFMessage the transforms of a frame."""
    if not child_frame:
        return (message,)
    return [one for one in _framed(message) if one.child_frame_id == child_frame]


def _framed(message: Message) -> Sequence[Message]:
    """Return the messages with a frame: the transforms of a TFMessage, or the message itself."""
    return message.transforms if hasattr(message, "transforms") else (message,)


def _refuse_unknown_frame(path: Path, reader: AnyReader, place: Place, those: Iterable[Mapped]) -> None:
    """Refuse a frame that no message of its topic has; a topic without messages is a gap."""
    connections = [connection for connection in reader.connections if connection.topic == place.topic]
    messages = (reader.deserialize(data, one.msgtype) for one, _, data in reader.messages(connections))
    if frames := {part.child_frame_id for message in messages for part in _framed(message)}:
        where = next(one.where for one in those if one.place == place)
        known = printable(nearest(place.child_frame, sorted(frames)))
        raise InputError(f"{place} of {path} has no frame {place.child_frame!r}: {known}", where)


def _stamp(message: Message) -> int:
    """Return the time of a message's header [ns]; 0 if it has none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        return 0
    return int(stamp.sec) * 10**9 + int(getattr(stamp, "nanosec", 0))


def _getter(place: Place) -> Getter:
    parts = {X: _x, Y: _y, YAW: _yaw}
    if place.field in parts:
        return parts[place.field]
    steps: list[str | int] = []
    for step in (place.field or "data").split("."):
        match = _STEP.fullmatch(step)
        if match is None:
            return _never
        steps += [match[1], *map(int, re.findall(r"[0-9]+", match[2]))]
    return partial(_field, tuple(steps))


def _field(steps: tuple[str | int, ...], message: Message) -> float:
    for step in steps:
        if isinstance(step, str):
            message = getattr(message, step)
        elif step < len(message):
            message = message[step]
        else:
            return np.nan
    return float(message)


def _never(message: Message) -> float:
    raise ValueError


def _pose(message: Message) -> tuple[Message, Message]:
    """Return position and orientation in a message that has a pose or a transform somewhere."""
    for _ in range(3):
        if hasattr(message, "orientation"):
            return message.position, message.orientation
        if hasattr(message, "rotation"):
            return message.translation, message.rotation
        message = message.pose if hasattr(message, "pose") else message.transform
    raise AttributeError


def _x(message: Message) -> float:
    return float(message.x if hasattr(message, "theta") else _pose(message)[0].x)


def _y(message: Message) -> float:
    return float(message.y if hasattr(message, "theta") else _pose(message)[0].y)


def _yaw(message: Message) -> float:
    """Return the heading [rad] of a pose: the yaw of its quaternion, as REP 103 has it."""
    if hasattr(message, "theta"):
        return float(message.theta)
    q = _pose(message)[1]
    if q.x == 0.0 == q.y:
        return float(2.0 * np.arctan2(q.z, q.w)) if q.z or q.w else np.nan
    return float(np.arctan2(2.0 * (q.w * q.z + q.x * q.y), q.w * q.w + q.x * q.x - q.y * q.y - q.z * q.z))


def _no_field(path: Path, place: Place, message: Message, kind: str, where: Location | None) -> InputError:
    fields = [name for name in getattr(message, "__dataclass_fields__", {}) if not name.startswith("_")]
    frames = {"transforms", "child_frame_id"}
    if place.child_frame and not frames & {*fields}:
        return InputError(
            f"{place} of {path} has messages of type {kind}, which name no child_frame: leave it out", where
        )
    wanted = "pose in the plane" if place.field in (X, Y, YAW) else f"number {place.field or 'data'!r}"
    frame = "; a TFMessage needs child_frame" if "transforms" in fields else ""
    has = f"{place} of {path} has messages of type {kind}, which have no {wanted}"
    return InputError(f"{has}; their fields: {', '.join(fields)}{frame}", where)
