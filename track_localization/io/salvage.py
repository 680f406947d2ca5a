"""
What can still be read of a storage file that does not open: cut short, never closed, or odd.

The file is read from its beginning for as long as its records make sense.
"""

from __future__ import annotations

import contextlib
import dataclasses
import sqlite3
import struct
from collections.abc import Collection, Iterator
from pathlib import Path

from rosbags.rosbag2.storage_mcap import decompress

from track_localization.errors import DataError

SCHEMA, CHANNEL, MESSAGE, CHUNK, STATISTICS = 0x03, 0x04, 0x05, 0x06, 0x0B
MCAP_MAGIC = b'\x89MCAP0\r\n'


@dataclasses.dataclass(frozen=True)
class Channel:
    """A topic of a damaged file: what rosbags calls a connection."""

    id: int
    topic: str
    msgtype: str
    msgcount: int


class Salvage:
    """
    A stand-in for rosbags' Reader over the messages that were saved, by log time.

    ``lost`` is how many messages of all topics are missing at least.
    """

    def __init__(
        self,
        topics: dict[int, tuple[str, str]],
        rows: list[tuple[int, int, bytes]],
        written: int | None = None,
    ) -> None:
        """Take {id: (topic, type)}, rows of (id, log time [ns], CDR bytes), their true number."""
        self.lost = 1 if written is None else max(written - len(rows), 0)
        rows = [row for row in rows if row[0] in topics]
        self._rows = sorted(rows, key=lambda row: row[1])
        self.connections = [
            Channel(key, topic, kind, sum(row[0] == key for row in rows))
            for key, (topic, kind) in topics.items()
        ]

    def messages(self, connections: Collection[Channel]) -> Iterator[tuple[Channel, int, bytes]]:
        """Yield (channel, log time [ns], CDR bytes) of the given channels."""
        by_id = {channel.id: channel for channel in connections}
        for key, time_ns, data in self._rows:
            if key in by_id:
                yield by_id[key], time_ns, data


def salvage(path: Path) -> Salvage:
    """Return what an ``.mcap`` or ``.db3`` still holds; raise DataError if that is nothing."""
    try:
        saved = _mcap(path) if path.suffix == '.mcap' else _db3(path)
    except Exception as error:  # whatever damaged bytes lead to
        raise DataError(f'{path}: nothing in it can be read ({error})') from None
    if not any(channel.msgcount for channel in saved.connections):
        raise DataError(f'{path}: no message in it can be read')
    return saved


def _mcap(path: Path) -> Salvage:
    content = path.read_bytes()
    if not content.startswith(MCAP_MAGIC):
        raise DataError('not an mcap file')
    schemas: dict[int, str] = {0: ''}
    channels: dict[int, tuple[str, str]] = {}
    rows: list[tuple[int, int, bytes]] = []
    written = None
    for op, body in _mcap_records(content[len(MCAP_MAGIC) :]):
        if op == SCHEMA:
            schemas[struct.unpack_from('<H', body)[0]] = _text(body, 2)[0]
        elif op == CHANNEL:
            key, schema = struct.unpack_from('<HH', body)
            topic, at = _text(body, 4)
            if _text(body, at)[0] == 'cdr':
                channels[key] = (topic, schemas.get(schema, ''))
        elif op == MESSAGE and len(body) >= 22:
            key, _, time_ns = struct.unpack_from('<HIQ', body)
            rows.append((key, time_ns, body[22:]))
        elif op == STATISTICS:
            (written,) = struct.unpack_from('<Q', body)
    return Salvage(channels, rows, written)


def _mcap_records(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield (opcode, body) of the whole records, those inside chunks included."""
    at = 0
    while at + 9 <= len(content):
        op, size = struct.unpack_from('<BQ', content, at)
        body = content[at + 9 : at + 9 + size]
        whole = len(body) == size
        at += 9 + size
        if op == CHUNK:
            yield from _mcap_records(_chunk(body))
        elif whole:
            yield op, body


def _chunk(body: bytes) -> bytes:
    """Return a chunk's records: as far as they go if it is cut and not compressed, else all."""
    if len(body) < 40:
        return b''
    size, crc = struct.unpack_from('<QI', body, 16)
    compression, at = _text(body, 28)
    data = body[at + 8 :]
    if not compression:
        return data
    try:
        return decompress(data, compression, size, crc)
    except Exception:  # each decompressor has errors of its own
        return b''


def _text(body: bytes, at: int) -> tuple[str, int]:
    """Return a length-prefixed string and the place after it."""
    (size,) = struct.unpack_from('<I', body, at)
    return body[at + 4 : at + 4 + size].decode(), at + 4 + size


def _db3(path: Path) -> Salvage:
    content = path.read_bytes()
    page = struct.unpack_from('>H', content, 16)[0]
    page = 65536 if page == 1 else page
    with contextlib.closing(sqlite3.connect(':memory:')) as database:
        database.deserialize(content[: len(content) // page * page])  # half a page reads as zeros
        database.execute('PRAGMA writable_schema = ON')  # lets a file with missing pages open
        topics = {
            key: (topic, kind)
            for key, topic, kind in database.execute('SELECT id, name, type FROM topics')
        }
        rows = []
        with contextlib.suppress(sqlite3.Error):  # the first missing page ends it
            for row in database.execute(
                'SELECT topic_id, timestamp, data FROM messages NOT INDEXED'
            ):
                rows.append(row)
    return Salvage(topics, rows)
