"""Opening the shared memory of a bus, and copying tables out of it.

The reader uses `pread`, not a mapping. If the file is truncated meanwhile, that is an error, and
does not end the process (SIGBUS). Every value is checked before it is used. The rules of versions
are in `client_c/include/ecat/ecat_shm.h`. The C client uses the same sentences in its errors.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ecatd.base.bus_name import check_bus_name
from ecatd.base.errors import JOIN, NotPermittedError, StateError, UnreachableError
from ecatd.base.file_locks import held
from ecatd.linux.systemd_services import how_to_start

from . import contract as shm
from .files import find, open_out

_TRIES = 1000  # until a page is copied in which the engine did not write

_LIMITS = {
    "slave_count": shm.MAX_SLAVES,
    "domain_count": shm.MAX_DOMAINS,
    "slot_count": shm.SLOTS,
    "can_count": shm.MAX_CAN,
}


@dataclass(frozen=True, slots=True)
class Page:
    """One exchange of a domain.

    Attributes:
        head: `ecat_shm_page`.
        image: Outputs, then inputs.
        torn: The writer has stopped in the middle: parts may be of two cycles.
    """

    head: Any
    image: bytes
    torn: bool


@contextmanager
def opened(bus: str) -> Iterator[Reader]:
    """The shared memory of a bus, to read tables of it.

    Raises:
        UsageError: `bus` is no name of a bus.
        UnreachableError: There is no such shared memory.
        NotPermittedError: This user may not read it.
        EcatError: It cannot be opened for another reason.
    """
    try:
        fd, path = find(check_bus_name(bus))
    except FileNotFoundError:
        raise _not_running(bus) from None
    except PermissionError as error:
        raise NotPermittedError(f"no right to read bus '{bus}': {JOIN}") from error
    try:
        yield Reader(fd, bus, path)
    finally:
        os.close(fd)


def _not_running(bus: str) -> UnreachableError:
    return UnreachableError(f"bus '{bus}' is not running; {how_to_start(bus)}")


def version(layout: int) -> str:
    """A layout version as it is printed: `1.0`."""
    return f"{layout >> 16}.{layout & 0xFFFF}"


class Reader:
    """The open shared memory of a bus.

    Attributes:
        bus: Name of the bus.
        path: The file.
    """

    def __init__(self, fd: int, bus: str, path: Path) -> None:
        self._fd = fd
        self.bus = bus
        self.path = path

    @property
    def size(self) -> int:
        """Bytes of the file."""
        return os.fstat(self._fd).st_size

    @property
    def alive(self) -> bool:
        """Whether the daemon that made the shared memory lives."""
        return held(self._fd, shm.LOCK_DAEMON)

    def header(self, *, leftover: bool = False) -> Any:
        """`ecat_shm_header`, checked as far as it can be by itself.

        Args:
            leftover: Also of shared memory whose daemon was killed.

        Raises:
            UnreachableError: No daemon serves the bus, or it is still starting.
            StateError: The shared memory is damaged, or of another version.
        """
        alive = self.alive
        if not alive and not leftover:
            raise _not_running(self.bus)
        room = shm.size("ecat_shm_header")
        data = os.pread(self._fd, room, 0)
        if len(data) < room:
            raise self._unfinished(alive, f"{len(data)} bytes, and a header has {room}")
        head = shm.struct("ecat_shm_header").from_buffer_copy(data)
        if head.layout == 0:
            raise self._unfinished(alive, "its daemon never finished it")
        if head.magic != shm.SHM_MAGIC:
            raise self.damaged(f"magic number at byte 0 is {shm.printable(data[:8])!r}")
        if head.layout >> 16 != shm.LAYOUT >> 16 or head.layout < shm.LAYOUT:
            cure = "update the client, and generate libraries again"
            if head.layout < shm.LAYOUT:
                cure = "update the daemon, if that is not done yet, and restart its service"
            raise StateError(
                f"the daemon of bus '{self.bus}' speaks layout {version(head.layout)}, this "
                f"client {version(shm.LAYOUT)}: {cure}"
            )
        if head.size > self.size:
            raise self.damaged(f"size: it should have {head.size} bytes, and has {self.size}")
        return head

    def _unfinished(self, alive: bool, what: str) -> UnreachableError:
        if alive:
            return UnreachableError(f"the daemon of bus '{self.bus}' is still starting")
        return UnreachableError(
            f"{self.path} is a leftover without content ({what}); the next start of ecatd replaces "
            f"it, or remove it"
        )

    def table(self, head: Any, name: str) -> list[Any]:
        """Copies of all rows of a table, by its name in `shm.TABLES`.

        Raises:
            StateError: It does not lie within the shared memory, or is larger than any can be.
        """
        table = shm.TABLES[name]
        if table.counted in _LIMITS:
            count, limit = getattr(head, table.counted), _LIMITS[table.counted]
            if count > limit:
                raise self.damaged(f"{table.counted} {count} of the header is more than {limit}")
        return self.rows(table.struct, getattr(head, f"{name}_offset"), table.count(head))

    def rows(self, name: str, offset: int, count: int) -> list[Any]:
        """Copies of rows of a struct.

        Raises:
            StateError: They do not lie within the shared memory.
        """
        length = count * shm.size(name)
        data = b""
        if offset % 8 == 0 and offset + length <= self.size:
            data = os.pread(self._fd, length, offset)
        if len(data) != length:
            raise self.damaged(f"table {name}: {count} entries cannot be at byte {offset}")
        return list((shm.struct(name) * count).from_buffer_copy(data))

    def page(self, domain: Any) -> Page:
        """The newest exchange of a domain.

        Args:
            domain: Its `ecat_shm_domain`.

        Raises:
            StateError: It does not lie within the shared memory.
        """
        offset, size = domain.page_offset, shm.size("ecat_shm_page")
        if offset + size + domain.image_bytes > self.size:  # before so much memory is asked for
            raise self._no_room(domain)
        for _ in range(_TRIES):
            (before,) = self.rows("ecat_shm_page", offset, 1)
            image = os.pread(self._fd, domain.image_bytes, offset + size)
            (after,) = self.rows("ecat_shm_page", offset, 1)
            if before.seq == after.seq and before.seq % 2 == 0:
                break
        if len(image) != domain.image_bytes:
            raise self._no_room(domain)
        return Page(after, image, bool(before.seq != after.seq or after.seq % 2))

    def _no_room(self, domain: Any) -> StateError:
        return self.damaged(
            f"page at byte {domain.page_offset}: there is no room for {domain.image_bytes} bytes "
            f"of image"
        )

    @contextmanager
    def slots(self, head: Any) -> Iterator[SlotReader]:
        """The shared memory in which clients have their slots.

        Raises:
            EcatError: It cannot be read, is damaged, or belongs to another run of the daemon.
        """
        path = self.path.with_name(f"{self.path.name}.out")
        try:
            fd = open_out(self.path)
        except PermissionError as error:
            raise NotPermittedError(f"no right to read {path}: {JOIN}") from error
        except FileNotFoundError as error:
            raise StateError(
                f"there is no {path}, where clients say who they are; restart the daemon"
            ) from error
        try:
            yield SlotReader(fd, path, head, self)
        finally:
            os.close(fd)

    def damaged(self, what: str) -> StateError:
        """The error that something in the shared memory makes no sense."""
        return StateError(
            f"the shared memory of bus '{self.bus}' is damaged ({what}); restart the daemon"
        )


class SlotReader:
    """The open `.out` shared memory of a bus: what clients say."""

    def __init__(self, fd: int, path: Path, head: Any, reader: Reader) -> None:
        self._fd = fd
        self._size = os.fstat(fd).st_size
        data = os.pread(fd, shm.size("ecat_out_header"), 0) if self._size else b""
        if len(data) < shm.size("ecat_out_header"):
            raise reader.damaged(f"{path} has no header")
        self.header = shm.struct("ecat_out_header").from_buffer_copy(data)
        if self.header.magic != shm.OUT_MAGIC:
            raise reader.damaged(f"magic number of {path} is {shm.printable(data[:8])!r}")
        if self.header.instance != head.instance or self.header.layout != head.layout:
            raise reader.damaged(f"{path} is of another run of the daemon")
        if self.header.slot_count > shm.SLOTS:
            raise reader.damaged(f"{path} has {self.header.slot_count} slots")

    def doorbell(self, slot: int) -> Any:
        """`ecat_out_doorbell` of a slot, or None where the file was cut short."""
        size = shm.size("ecat_out_doorbell")
        return self._one("ecat_out_doorbell", self.header.doorbells_offset + slot * size)

    def slot(self, slot: int) -> Any:
        """`ecat_out_slot` of a slot, or None where the file was cut short."""
        return self._one("ecat_out_slot", self.slot_offset(slot))

    def slot_offset(self, slot: int) -> int:
        """Where a slot begins."""
        return int(self.header.slots_offset + slot * self.header.slot_stride)

    def requests(self, slot: int) -> list[Any]:
        """The `ecat_out_request`s of a slot."""
        at = self.slot_offset(slot) + shm.size("ecat_out_slot")
        step = shm.size("ecat_out_request")
        found = (self._one("ecat_out_request", at + n * step) for n in range(shm.REQUESTS))
        return [request for request in found if request is not None]

    def images(self, slot: int) -> list[Any]:
        """The `ecat_out_image`s of a slot, without the values behind them."""
        at = self.slot_offset(slot) + self.header.images_offset
        step = self.header.image_stride
        found = (self._one("ecat_out_image", at + n * step) for n in range(shm.IMAGES))
        return [image for image in found if image is not None]

    def can(self, slot: int, channel: int) -> Any:
        """`ecat_out_can` of a slot, or None where the file was cut short."""
        at = self.slot_offset(slot) + self.header.can_offset
        return self._one("ecat_out_can", at + channel * shm.size("ecat_out_can"))

    def held(self, slot: int) -> bool:
        """Whether a living process has the slot."""
        return held(self._fd, shm.LOCK_SLOT + slot)

    def _one(self, name: str, offset: int) -> Any:
        size = shm.size(name)
        data = os.pread(self._fd, size, offset) if offset + size <= self._size else b""
        return shm.struct(name).from_buffer_copy(data) if len(data) == size else None
