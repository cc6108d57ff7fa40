"""An MCAP file, written chunk by chunk: https://mcap.dev/spec.

The libraries for it take one message at a time, which is too slow for the million messages of a run. Here a chunk
arrives whole, as the bytes of its messages with times and offsets.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from io import FileIO
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.storage import write_all

MAGIC = b"\x89MCAP0\r\n"
MOST_CHANNELS = 2**16 - 1
HEAD = 31
"""Bytes of a message's record before its data."""
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _MESSAGE_INDEX, _CHUNK_INDEX = range(1, 9)
_ATTACHMENT, _ATTACHMENT_INDEX, _STATISTICS, _METADATA, _METADATA_INDEX, _SUMMARY_OFFSET, _DATA_END = range(9, 16)

Compress: TypeAlias = Callable[[bytes | memoryview], bytes]


@dataclass(frozen=True, eq=False)
class Chunk:
    """Messages one after the other.

    Attributes
    ----------
    records : memoryview
        The records of the messages.
    index : dict
        By the channel's number, time and offset (n, 2) in the records of each of its messages, in the order of time.
    """

    records: memoryview
    index: Mapping[int, NDArray[np.uint64]] = field(repr=False)


def message_record(channel: int, data: bytes | bytearray, time: int = 0, sequence: int = 0) -> bytes:
    """Return the record of a message; its number among those of the channel and its two times end the first `HEAD`."""
    return struct.pack("<BQHIQQ", _MESSAGE, HEAD - 9 + len(data), channel, sequence, time, time) + data


class McapFile:
    """A file of profile ``ros2`` that grows.

    Parameters
    ----------
    file
        An empty file.
    library
        Name and version of the program that writes it.
    compression, compress
        How chunks are compressed, ``lz4`` or ``zstd``, and the function that does.
    """

    def __init__(self, file: FileIO, library: str, compression: str, compress: Compress) -> None:
        self._file, self._compression, self._compress = file, compression, compress
        self._at = 0
        self._schemas: dict[str, bytes] = {}
        self._channels: list[bytes] = []
        self._summary: dict[int, list[bytes]] = {_CHUNK_INDEX: [], _ATTACHMENT_INDEX: [], _METADATA_INDEX: []}
        self._counts: Counter[int] = Counter()
        self._span: tuple[int, int] | None = None
        self._write(MAGIC)
        self._write(_record(_HEADER, _text("ros2"), _text(library)))

    def channel(self, topic: str, schema: str, definition: str, metadata: Mapping[str, str]) -> int:
        """Add a channel of messages in CDR, and return its number.

        Parameters
        ----------
        topic
            Its topic.
        schema, definition
            Name and definition of the type of its messages.
        metadata
            Whatever else is known of it.
        """
        if schema not in self._schemas:
            number = struct.pack("<H", len(self._schemas) + 1)
            text = definition.encode()
            record = _record(_SCHEMA, number, _text(schema), _text("ros2msg"), struct.pack("<I", len(text)), text)
            self._schemas[schema] = record
            self._write(record)
        ids = struct.pack("<HH", len(self._channels) + 1, list(self._schemas).index(schema) + 1)
        record = _record(_CHANNEL, ids, _text(topic), _text("cdr"), _map(metadata))
        self._channels.append(record)
        self._write(record)
        return len(self._channels)

    def chunk(self, chunk: Chunk) -> None:
        """Add messages."""
        start = min(int(entries[0, 0]) for entries in chunk.index.values())
        end = max(int(entries[-1, 0]) for entries in chunk.index.values())
        packed = self._compress(chunk.records)
        size, crc = len(chunk.records), zlib.crc32(chunk.records)
        head = struct.pack("<QQQI", start, end, size, crc)
        compression, length = _text(self._compression), struct.pack("<Q", len(packed))
        at = self._at
        self._write(_record(_CHUNK, head, compression, length, packed))
        length_of_chunk, indices = self._at - at, {}
        parts = []
        place = self._at
        for channel, entries in chunk.index.items():
            indices[channel] = place
            parts.append(struct.pack("<BQHI", _MESSAGE_INDEX, 6 + entries.nbytes, channel, entries.nbytes))
            parts.append(entries.tobytes())
            place += 15 + entries.nbytes
            self._counts[channel] += len(entries)
        self._write(b"".join(parts))
        offsets = b"".join(struct.pack("<HQ", channel, offset) for channel, offset in indices.items())
        self._summary[_CHUNK_INDEX].append(
            _record(
                _CHUNK_INDEX,
                struct.pack("<QQQQI", start, end, at, length_of_chunk, len(offsets)),
                offsets,
                struct.pack("<Q", self._at - at - length_of_chunk),
                compression,
                struct.pack("<QQ", len(packed), size),
            )
        )
        self._span = (start, end) if self._span is None else (min(self._span[0], start), max(self._span[1], end))

    def attachment(self, name: str, media_type: str, data: bytes, time: int) -> None:
        """Add a file."""
        about = struct.pack("<QQ", time, time)
        content = b"".join([about, _text(name), _text(media_type), struct.pack("<Q", len(data)), data])
        at = self._at
        self._write(_record(_ATTACHMENT, content, struct.pack("<I", zlib.crc32(content))))
        place = struct.pack("<QQ", at, self._at - at)
        self._summary[_ATTACHMENT_INDEX].append(
            _record(_ATTACHMENT_INDEX, place, about, struct.pack("<Q", len(data)), _text(name), _text(media_type))
        )

    def metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Add texts by name."""
        at = self._at
        self._write(_record(_METADATA, _text(name), _map(content)))
        place = struct.pack("<QQ", at, self._at - at)
        self._summary[_METADATA_INDEX].append(_record(_METADATA_INDEX, place, _text(name)))

    def finish(self) -> None:
        """Write what a reader finds everything by."""
        self._write(_record(_DATA_END, bytes(4)))
        start = self._at
        groups: dict[int, Sequence[bytes]] = {
            _SCHEMA: list(self._schemas.values()),
            _CHANNEL: self._channels,
            _STATISTICS: [self._statistics()],
            **self._summary,
        }
        summary, offsets = b"", []
        for kind, records in groups.items():
            group = b"".join(records)
            if group:
                offsets.append(_record(_SUMMARY_OFFSET, struct.pack("<BQQ", kind, start + len(summary), len(group))))
            summary += group
        place = struct.pack("<QQ", start, start + len(summary))
        summary += b"".join(offsets)
        crc = zlib.crc32(summary + struct.pack("<BQ", _FOOTER, 20) + place)
        self._write(summary + _record(_FOOTER, place, struct.pack("<I", crc)) + MAGIC)

    def _statistics(self) -> bytes:
        counts = b"".join(struct.pack("<HQ", channel, count) for channel, count in sorted(self._counts.items()))
        start, end = self._span or (0, 0)
        kinds = (_ATTACHMENT_INDEX, _METADATA_INDEX, _CHUNK_INDEX)
        numbers = (len(self._schemas), len(self._channels), *(len(self._summary[kind]) for kind in kinds))
        head = struct.pack("<QHIIIIQQI", self._counts.total(), *numbers, start, end, len(counts))
        return _record(_STATISTICS, head, counts)

    def _write(self, data: bytes) -> None:
        write_all(self._file, data)
        self._at += len(data)


def _record(kind: int, *content: bytes) -> bytes:
    return b"".join([struct.pack("<BQ", kind, sum(map(len, content))), *content])


def _text(text: str) -> bytes:
    data = text.encode()
    return struct.pack("<I", len(data)) + data


def _map(content: Mapping[str, str]) -> bytes:
    data = b"".join(_text(name) + _text(value) for name, value in content.items())
    return struct.pack("<I", len(data)) + data
