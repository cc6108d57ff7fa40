"""Messages of ROS 2 in an MCAP file: poses, frames, outlines, paths, and each signal as a topic of its own.

Most topics have a message at each tick, and these have the same length at all ticks. So the messages of a tick are one
row of bytes that is laid out once; a chunk is some of these rows, in which only numbers and times are filled in.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.export.formats import Options
from cosim.export.mcap_file import HEAD, MOST_CHANNELS, Chunk, Compress, McapFile, message_record
from cosim.export.ros2_topics import Latched, Topic, topics_of
from cosim.export.ros2_types import definition, full_name
from cosim.moments import SECOND
from cosim.results.files import replacing
from cosim.results.result import Result

_CHUNK = 2 * 1024**2
"""Bytes of a chunk at most."""
_FEWEST = 16
"""Ticks of a chunk, even if they have more: a chunk takes a while for each topic."""
_TIMES = np.dtype([("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")])
"""The last bytes of a message's head."""
_ABOUT = ("title", "scenario_name", "status", "seed", "step", "horizon", "versions", "scenario_file", "changes")


@dataclass(frozen=True, eq=False)
class _Row:
    """The messages of a tick: their bytes, and where numbers, times and heads of messages are filled in."""

    data: bytes
    numbers: list[tuple[int, NDArray[np.float64]]]
    stamps: list[int]
    messages: NDArray[np.uint64]


def write(result: Result, path: Path, options: Options) -> None:
    """Write the file.

    Raises
    ------
    InputError
        The package that compresses is not installed, or there are more signals than a file can have.
    OutputError
        The file cannot be written.
    """
    compress = _compression()
    topics, latched = topics_of(result)
    if len(topics) + len(latched) > MOST_CHANNELS:
        raise InputError(f"{path}: the run has {len(topics)} signals, but an MCAP file {MOST_CHANNELS} topics at most")
    times = _times(result, options)
    stamps = times // SECOND | times % SECOND << np.uint64(32)
    with replacing(path) as raw:
        file = McapFile(raw, f"formation-cosim {version('formation-cosim')}", "zstd", compress)
        row = _row([(_channel(file, topic, topic.about), topic) for topic in topics])
        occasional = [(_channel(file, one, {}, latched=True), one, one.message(stamps)) for one in latched]
        for chunk in _chunks(row, times, stamps, occasional):
            file.chunk(chunk)
        attributes = {name: str(result.attrs[name]) for name in _ABOUT if name in result.attrs}
        file.metadata("formation", attributes)
        file.attachment("scenario.xml", "application/xml", str(result.attrs["scenario"]).encode(), int(times[0]))
        file.finish()


def _compression() -> Compress:
    try:
        import zstandard
    except ImportError:
        raise InputError(
            "an MCAP file needs the package zstandard; install it: python -m pip install 'formation-cosim[export]'"
        ) from None
    compress: Compress = zstandard.ZstdCompressor(level=1).compress
    return compress


def _times(result: Result, options: Options) -> NDArray[np.uint64]:
    """Return the times of all ticks [ns]."""
    found: NDArray[np.uint64] = np.rint(result["time"].values * SECOND).astype(np.uint64) + np.uint64(options.start)
    return found


def _channel(file: McapFile, topic: Topic | Latched, about: dict[str, str], latched: bool = False) -> int:
    offered = {"offered_qos_profiles": _quality(latched)}
    return file.channel(topic.name, full_name(topic.type), definition(topic.type), offered | about)


def _quality(latched: bool) -> str:
    """Return the quality of service that a player offers, in the words of rosbag2; the last message may be kept."""
    forever = "{sec: 9223372036, nsec: 854775807}"
    lines = [
        "- history: 1",  # keep last
        f"depth: {1 if latched else 10}",
        "reliability: 1",  # reliable
        f"durability: {1 if latched else 2}",  # transient local, volatile
        f"deadline: {forever}",
        f"lifespan: {forever}",
        "liveliness: 1",  # automatic
        f"liveliness_lease_duration: {forever}",
        "avoid_ros_namespace_conventions: false",
    ]
    return "\n  ".join(lines)


def _row(channels: Sequence[tuple[int, Topic]]) -> _Row:
    data = bytearray()
    row = _Row(b"", [], [], np.zeros((len(channels), 2), np.uint64))
    for at, (channel, topic) in enumerate(channels):
        row.messages[at] = channel, len(data)
        inner = len(data) + HEAD
        row.numbers.extend((inner + offset, values) for offset, values in topic.message.numbers)
        row.stamps.extend(inner + offset for offset in topic.message.stamps)
        data += message_record(channel, topic.message.data)
    return _Row(bytes(data), row.numbers, row.stamps, row.messages)


def _chunks(
    row: _Row,
    times: NDArray[np.uint64],
    stamps: NDArray[np.uint64],
    occasional: Sequence[tuple[int, Latched, bytes | bytearray]],
) -> Iterator[Chunk]:
    width = len(row.data)
    samples = len(times)
    count = min(max(_FEWEST, _CHUNK // width), samples)
    rows = np.empty((count, width), np.uint8)
    rows[:] = np.frombuffer(row.data, np.uint8)

    def column(offset: int, kind: Any, length: int) -> NDArray[Any]:
        return np.ndarray((length,), kind, rows, offset, (width,))

    sequences = dict.fromkeys((channel for channel, _, _ in occasional), 0)
    for start in range(0, samples, count):
        part = slice(start, min(start + count, samples))
        length = part.stop - start
        heads = np.empty(length, _TIMES)
        heads["sequence"], heads["log"], heads["publish"] = np.arange(start, part.stop), times[part], times[part]
        for offset, values in row.numbers:
            column(offset, "<f8", length)[:] = values[part]
        for offset in row.stamps:
            column(offset, "<u8", length)[:] = stamps[part]
        for _, offset in row.messages:
            column(int(offset) + HEAD - _TIMES.itemsize, _TIMES, length)[:] = heads
        before = bytearray()
        index: dict[int, NDArray[np.uint64]] = {}
        for channel, one, data in occasional:
            if start == 0 or one.repeated:
                index[channel] = np.array([[times[start], len(before)]], np.uint64)
                before += message_record(channel, data, int(times[start]), sequences[channel])
                sequences[channel] += 1
        entries = np.empty((len(row.messages), length, 2), np.uint64)
        entries[:, :, 0] = times[part]
        entries[:, :, 1] = (
            row.messages[:, 1:] + np.uint64(len(before)) + np.arange(length, dtype=np.uint64) * np.uint64(width)
        )
        index.update(zip(row.messages[:, 0].tolist(), entries, strict=True))
        yield Chunk(memoryview(b"".join([before, rows[:length].data])), index)
