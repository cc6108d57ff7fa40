"""Messages of ROS 2 in an MCAP file: poses, frames, outlines, paths, and each signal as a topic of its own.

Most topics have a message at each tick, and these have the same length at all ticks. So the messages of a tick are one
row of bytes that is laid out once; a chunk is some of these rows, in which only numbers and times are filled in.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.export.formats import Options
from cosim.export.mcap_file import HEAD, MOST_CHANNELS, Chunk, Compress, McapFile, message_record
from cosim.export.ros2_topics import Occasional, Stamps, Topic, topics_of
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


Times: TypeAlias = NDArray[np.uint64]


class _Rows:
    """The messages of each tick, one topic after the other, as rows of bytes.

    Parameters
    ----------
    channels
        The topics, each with the number of its channel.
    samples
        Number of ticks.
    """

    def __init__(self, channels: Sequence[tuple[int, Topic]], samples: int) -> None:
        data = bytearray()
        self._numbers: list[tuple[int, NDArray[np.float64]]] = []
        self._stamps: list[int] = []
        self._channels: list[int] = []
        self._offsets = np.empty((len(channels), 1), np.uint64)
        for at, (channel, topic) in enumerate(channels):
            self._channels.append(channel)
            self._offsets[at] = len(data)
            inner = len(data) + HEAD
            self._numbers += [(inner + offset, values) for offset, values in topic.message.numbers]
            self._stamps += [inner + offset for offset in topic.message.stamps]
            data += message_record(channel, topic.message.data)
        self._width = len(data)
        self.at_once = min(max(_FEWEST, _CHUNK // self._width), samples)
        self._rows = np.empty((self.at_once, self._width), np.uint8)
        self._rows[:] = np.frombuffer(data, np.uint8)

    def filled(self, part: slice, times: Times, stamps: Stamps) -> memoryview:
        """Return the messages of some ticks, `at_once` at most, until the next call."""
        length = part.stop - part.start
        heads = np.empty(length, _TIMES)
        heads["sequence"] = np.arange(part.start, part.stop)
        heads["log"] = heads["publish"] = times[part]
        for offset, values in self._numbers:
            self._column(offset, "<f8", length)[:] = values[part]
        for offset in self._stamps:
            self._column(offset, "<u8", length)[:] = stamps[part]
        for offset in self._offsets[:, 0].tolist():
            self._column(offset + HEAD - _TIMES.itemsize, _TIMES, length)[:] = heads
        return self._rows[:length].data

    def _column(self, offset: int, kind: Any, length: int) -> NDArray[Any]:
        return np.ndarray((length,), kind, self._rows, offset, (self._width,))

    def index(self, part: slice, times: Times, before: int) -> dict[int, NDArray[np.uint64]]:
        """Return the index of a chunk with some ticks, in which so many bytes are before them."""
        length = part.stop - part.start
        rows = np.uint64(before) + np.arange(length, dtype=np.uint64) * np.uint64(self._width)
        entries = np.empty((len(self._channels), length, 2), np.uint64)
        entries[:, :, 0] = times[part]
        entries[:, :, 1] = self._offsets + rows
        return dict(zip(self._channels, entries, strict=True))


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
    topics, occasional = topics_of(result)
    if len(topics) + len(occasional) > MOST_CHANNELS:
        raise InputError(f"{path}: the run has {len(topics)} signals, but an MCAP file {MOST_CHANNELS} topics at most")
    times = _times(result, options)
    stamps = times // SECOND | times % SECOND << np.uint64(32)
    with replacing(path) as raw:
        file = McapFile(raw, f"formation-cosim {version('formation-cosim')}", "zstd", compress)
        rows = _Rows([(_channel(file, topic, topic.about), topic) for topic in topics], len(times))
        further = [(_channel(file, one, {}, one.latched), one.repeated, one.messages(stamps)) for one in occasional]
        for chunk in _chunks(rows, times, stamps, further):
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


def _times(result: Result, options: Options) -> Times:
    """Return the times of all ticks [ns]."""
    found: Times = np.rint(result["time"].values * SECOND).astype(np.uint64) + np.uint64(options.start)
    return found


def _channel(file: McapFile, topic: Topic | Occasional, about: dict[str, str], latched: bool = False) -> int:
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


def _chunks(
    rows: _Rows, times: Times, stamps: Stamps, further: Sequence[tuple[int, bool, Sequence[tuple[int, bytes]]]]
) -> Iterator[Chunk]:
    """Yield the chunks of a file: some ticks each, and before them the messages that there are now and then.

    A chunk begins at each tick with such messages, so that all are in the order of time. They are given by channel:
    whether the first one is repeated with each chunk, and each with its tick.
    """
    starts = {*range(0, len(times), rows.at_once), *(tick for _, _, messages in further for tick, _ in messages)}
    sequences: Counter[int] = Counter()
    for start, stop in pairwise([*sorted(starts), len(times)]):
        part = slice(start, stop)
        before = bytearray()
        index: dict[int, NDArray[np.uint64]] = {}
        for channel, repeated, messages in further:
            places = []
            for data in [messages[0][1]] if repeated else [data for tick, data in messages if tick == start]:
                places.append((int(times[start]), len(before)))
                before += message_record(channel, data, int(times[start]), sequences[channel])
                sequences[channel] += 1
            if places:
                index[channel] = np.array(places, np.uint64)
        index |= rows.index(part, times, len(before))
        yield Chunk(memoryview(b"".join([before, rows.filled(part, times, stamps)])), index)
