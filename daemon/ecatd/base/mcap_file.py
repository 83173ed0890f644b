"""Reads MCAP files: all that is whole in them, and what is damaged.

A file whose writer was killed has no end, and one from a bad disk has wrong bytes somewhere. What
can be read is read, chunk by chunk, and each chunk is checked; then the damage is told.
"""

from __future__ import annotations

import errno
import io
import json
import struct
import time
import zlib
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

from .files import open_regular

_MAGIC = b"\x89MCAP0\r\n"
_HEAD = 9
"""Bytes of a record before its content: its kind, and its length."""
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _ATTACHMENT, _DATA_END = 3, 4, 5, 6, 9, 15


class DamagedError(ValueError):
    """Some of a file could be read, and the rest is damaged or missing; the message says how much.

    It is raised behind all that could be read.
    """


class McapFile:
    """An MCAP file.

    Args:
        path: The file.

    Attributes:
        schemas: The schemas, by number.
        channels: The channels, by number.
        sizes: Bytes of the attachments, by name.
        is_cut: Whether its end is missing.

    Raises:
        OSError: The file cannot be read.
        ValueError: It is no MCAP file.
        ImportError: The package `mcap` is missing.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._records: Any = import_module("mcap.records")
        self._stream: Any = import_module("mcap.data_stream").ReadDataStream
        self._break_up: Any = import_module("mcap.stream_reader").breakup_chunk
        self.schemas: dict[int, Any] = {}
        self.channels: dict[int, Any] = {}
        self.sizes: dict[str, int] = {}
        self._attachments: dict[str, int] = {}  # where they are
        self._chunks: list[int] = []
        self.is_cut = False
        with open_regular(path) as file:
            if file.read(len(_MAGIC)) != _MAGIC:
                raise ValueError(
                    f"{path}: it is no MCAP file: name a recording (`ecatctl record`) or an "
                    "incident"
                )
            file.seek(0)
            try:
                summary = import_module("mcap.reader").make_reader(file).get_summary()
            except Exception as error:  # the library raises many kinds of errors
                # EINVAL: it has looked for a place in front of a file that is too short.
                if isinstance(error, OSError) and error.errno != errno.EINVAL:
                    raise
                summary = None
        if summary is None:
            self._look()
            return
        self.schemas, self.channels = dict(summary.schemas), dict(summary.channels)
        self._chunks = sorted(item.chunk_start_offset for item in summary.chunk_indexes)
        for item in summary.attachment_indexes:
            self.sizes[item.name], self._attachments[item.name] = item.data_size, item.offset

    def _look(self) -> None:
        """Finds out what is in a file without a summary."""
        self.is_cut = True
        for offset, kind, content in self._all():
            if kind == _DATA_END:
                self.is_cut = False
                return
            try:
                if kind == _ATTACHMENT:
                    found = self._records.Attachment.read(self._stream(io.BytesIO(content)))
                    self.sizes[found.name] = len(found.data)
                    self._attachments[found.name] = offset
                else:
                    self._messages(kind, content)
            except Exception:  # of many kinds; who reads the messages is told
                continue

    def _all(self) -> Iterator[tuple[int, int, bytes]]:
        """Place, kind and content of each record that is whole, as far as lengths make sense."""
        size = self._path.stat().st_size
        with open_regular(self._path) as file:
            at = len(_MAGIC)
            while at + _HEAD <= size:
                file.seek(at)
                kind, length = struct.unpack("<BQ", file.read(_HEAD))
                if not kind or length > size - at - _HEAD:
                    return
                yield at, kind, file.read(length)
                at += _HEAD + length

    def _one(self, offset: int) -> tuple[int, int, bytes]:
        size = self._path.stat().st_size
        with open_regular(self._path) as file:
            file.seek(offset)
            kind, length = struct.unpack("<BQ", file.read(_HEAD))
            return offset, kind, file.read(min(length, size))

    def _messages(self, kind: int, content: bytes) -> list[Any]:
        """The messages of a record; takes schemas and channels."""
        stream, records = self._stream(io.BytesIO(content)), self._records
        if kind == _CHUNK:
            found = self._break_up(records.Chunk.read(stream), validate_crc=True)
        elif kind == _SCHEMA:
            found = [records.Schema.read(stream)]
        elif kind == _CHANNEL:
            found = [records.Channel.read(stream)]
        elif kind == _MESSAGE:
            found = [records.Message.read(stream, len(content))]
        else:
            found = []
        for item in found:
            if isinstance(item, records.Schema):
                self.schemas[item.id] = item
            elif isinstance(item, records.Channel):
                self.channels[item.id] = item
        return [item for item in found if isinstance(item, records.Message)]

    def messages(self, wanted: Callable[[Any, Any], bool]) -> Iterator[Any]:
        """Messages in the order of the file, which is that of time; a part is in memory at a time.

        Args:
            wanted: Whether messages of a channel with a schema (or None) are.

        Raises:
            OSError: The file cannot be read.
            DamagedError: There are no more, and some are damaged or missing.
        """
        count = last_ns = 0
        why, has_end = "", False
        parts = map(self._read_one, self._chunks) if self._chunks else self._all()
        for offset, kind, content in parts:
            if kind == _DATA_END:
                has_end = True
                break
            try:
                if self._chunks and kind != _CHUNK:
                    raise ValueError("there should be a chunk")
                found = self._messages(kind, content)
                chosen = [item for item in found if self._is(wanted, item)]
            except Exception as error:  # the library raises many kinds of errors
                why = why or f"is damaged at byte {offset}{in_words(error)}; copy it again"
                continue
            for item in chosen:
                count, last_ns = count + 1, item.log_time
                yield item
        if not why and not has_end and not self._chunks:
            why = "ends in the middle, as if its writer had been killed, or its copy is not whole"
        if why:
            what = f"{count} cycle{'s' * (count != 1)}"
            until = f", up to {_utc(last_ns)}," if count else ""
            raise DamagedError(f"{self._path} {why}: {what}{until} could be read")

    def _read_one(self, offset: int) -> tuple[int, int, bytes]:
        try:
            return self._one(offset)
        except struct.error:
            return offset, _CHUNK, b""  # which is no chunk

    def _is(self, wanted: Callable[[Any, Any], bool], message: Any) -> bool:
        channel = self.channels[message.channel_id]
        return wanted(channel, self.schemas.get(channel.schema_id))

    def attachment(self, name: str) -> bytes:
        """Content of an attachment.

        Raises:
            OSError: The file cannot be read.
            ValueError: There is none of this name, or it is damaged.
        """
        if name not in self._attachments:
            raise ValueError(f"{self._path} has no {name}")
        try:
            _, _, content = self._one(self._attachments[name])
            found = self._records.Attachment.read(self._stream(io.BytesIO(content)))
        except OSError:
            raise
        except Exception as error:  # the library raises many kinds of errors
            raise ValueError(f"{self._path} is damaged: {name}{in_words(error)}") from error
        (checksum,) = struct.unpack("<I", content[-4:])
        if checksum and checksum != zlib.crc32(content[:-4]):
            raise ValueError(f"{self._path} is damaged: {name} has another checksum")
        data: bytes = found.data
        return data


def in_words(error: Exception) -> str:
    """What an error adds to a sentence: other kinds than these have texts for programmers."""
    return f": {error}" if type(error) in (ValueError, json.JSONDecodeError) else ""


def _utc(time_ns: int) -> str:
    return time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime(time_ns // 10**9)) + " UTC"
