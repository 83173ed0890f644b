"""Reading the shared memory of a bus for its statistics.

With `pread` rather than through a mapping: a segment that is cut short meanwhile is an error then,
and not the end of the process (SIGBUS). Nothing of it is believed that was not checked.
"""

from __future__ import annotations

import array
import fcntl
import os
import stat
import struct as binary
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ecatd import shm
from ecatd.model.config import BUS_NAME, DOMAINS_MAX
from ecatd.model.errors import (
    JOIN,
    START,
    EcatError,
    NotPermittedError,
    StateError,
    UnreachableError,
    UsageError,
)

from .snapshot import (
    COUNTERS,
    DOMAIN_COUNTERS,
    TIMES,
    Clock,
    Counters,
    Domain,
    Grant,
    Histogram,
    Snapshot,
    Times,
)

_FLOCK = "hhqqi4x"  # struct flock of Linux on 64-bit machines
_TRIES = 5  # until a reading is taken in which no cycle ended
_NONE = (1 << 64) - 1  # smallest time of an empty histogram


def read(bus: str = "ecat0") -> Snapshot:
    """Reads all statistics of a bus on this machine; never waits.

    Counters are taken one by one: where a cycle ends during every attempt, some are of the cycle
    after that of the others.

    Raises:
        UsageError: `bus` is no name of a bus.
        UnreachableError: No daemon serves it, or the daemon is still starting.
        NotPermittedError: This user may not read it.
        StateError: The segment is damaged, or of another version.
    """
    with opened(bus) as segment:
        return segment.snapshot()


@contextmanager
def opened(bus: str) -> Iterator[OpenSegment]:
    """The segment of a bus, to read tables of it; raises as `read`."""
    if not BUS_NAME.fullmatch(bus):
        raise UsageError(f"'{bus}' is no bus name: use 1 to 31 letters, digits, '_' or '-'")
    path = shm.FOLDER / f"ecat.{bus}"
    try:
        fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    except FileNotFoundError:
        raise _not_running(bus) from None
    except PermissionError as error:
        raise NotPermittedError(f"no right to read bus '{bus}': {JOIN}") from error
    except OSError as error:
        raise EcatError(f"cannot open {path}: {error.strerror}") from error
    try:
        yield OpenSegment(fd, bus)
    finally:
        os.close(fd)


def _not_running(bus: str) -> UnreachableError:
    return UnreachableError(f"no ecatd serves bus '{bus}'; {START}")


class OpenSegment:
    """The open segment of a bus."""

    def __init__(self, fd: int, bus: str) -> None:
        self._fd = fd
        self._bus = bus

    def snapshot(self) -> Snapshot:
        """Reads until no cycle ended meanwhile, but not for ever."""
        for _ in range(_TRIES):
            snapshot = self._read()
            if self.header().cycle == snapshot.cycle:
                break
        return snapshot

    def _read(self) -> Snapshot:
        head = self.header()
        (health,) = self.rows("ecat_shm_health", head.health_offset, 1)
        settings = self.rows("ecat_shm_setting", head.settings_offset, len(shm.Setting))
        domains = self._domains(head)
        read_ns = time.monotonic_ns()
        if head.cycle_time_ns == 0:
            raise self.damaged("cycle time")
        return Snapshot(
            bus=self._bus,
            version=printable(head.version),
            state=shm.BusState(head.state),
            instance=head.instance,
            cycle_time_ns=head.cycle_time_ns,
            cycle=head.cycle,
            cycle_end_ns=head.cycle_end_ns,
            start_ns=health.start_ns,
            read_ns=read_ns,
            slaves_expected=head.slave_count,
            slaves_found=health.slaves_found,
            al_status=health.al_status,
            ring=shm.Ring(health.ring),
            ring_break=health.ring_break,
            links=(
                shm.Link(health.link_first),
                shm.Link(health.link_second),
            ),
            clock=Clock(
                shm.DcState(health.dc_state),
                health.dc_reference,
                health.dc_time_ns,
                health.dc_offset_ns,
                health.dc_drift_ppb,
            ),
            counters=Counters(**{name: getattr(health, name) for name in COUNTERS}),
            delay_cycles=tuple(health.delay_cycles),
            times=Times(**{name: _histogram(getattr(health, name)) for name in TIMES}),
            domains=domains,
            grants=tuple(
                Grant(kind, bool(row.wanted), bool(row.granted), row.value, row.error)
                for kind, row in zip(shm.Setting, settings, strict=True)
            ),
        )

    def header(self) -> Any:
        """The header, checked as far as it can be by itself."""
        status = os.fstat(self._fd)
        data = b""
        if stat.S_ISREG(status.st_mode):
            data = os.pread(self._fd, shm.size("ecat_shm_header"), 0)
        if not self._daemon_lives():
            raise _not_running(self._bus)  # a leftover of a daemon that was killed
        if len(data) < shm.size("ecat_shm_header"):
            raise self._starting()
        head = shm.struct("ecat_shm_header").from_buffer_copy(data)
        if head.layout == 0:
            raise self._starting()
        if head.magic != shm.SHM_MAGIC:
            raise self.damaged("magic number")
        if head.layout >> 16 != shm.LAYOUT >> 16 or head.layout < shm.LAYOUT:
            cure = "update the client, and generate libraries again"
            if head.layout < shm.LAYOUT:
                cure = "update the daemon"
            raise StateError(
                f"the daemon of bus '{self._bus}' speaks layout {_version(head.layout)}, this "
                f"client {_version(shm.LAYOUT)}: {cure}"
            )
        if head.size > status.st_size:
            raise self.damaged("size")
        return head

    def _domains(self, head: Any) -> tuple[Domain, ...]:
        count = head.domain_count
        if count > DOMAINS_MAX:
            raise self.damaged("number of domains")
        tables = self.rows("ecat_shm_domain", head.domains_offset, count)
        statuses = self.rows("ecat_shm_domain_status", head.domain_status_offset, count)
        made = []
        for number, (table, status) in enumerate(zip(tables, statuses, strict=True)):
            (page,) = self.rows("ecat_shm_page", table.page_offset, 1)
            made.append(
                Domain(
                    number=number,
                    name=printable(table.name),
                    divider=table.divider,
                    phase=table.phase,
                    output_bytes=table.output_bytes,
                    input_bytes=max(0, table.image_bytes - table.output_bytes),
                    wkc_expected=table.wkc_expected,
                    wkc=page.wkc,
                    wkc_state=shm.WkcState(page.wkc_state),
                    cycle=page.cycle,
                    **{name: getattr(status, name) for name in DOMAIN_COUNTERS},
                )
            )
        return tuple(made)

    def rows(self, name: str, offset: int, count: int) -> list[Any]:
        """Copies of the rows of a table."""
        length = count * shm.size(name)
        if offset % 8 or length > os.fstat(self._fd).st_size:
            raise self.damaged(f"table {name}")
        data = os.pread(self._fd, length, offset)
        if len(data) != length:
            raise self.damaged(f"table {name}")
        return list((shm.struct(name) * count).from_buffer_copy(data))

    def _daemon_lives(self) -> bool:
        """Whether the daemon holds its lock of the segment (see `client_c/src/internal.h`)."""
        ask = binary.pack(_FLOCK, fcntl.F_RDLCK, os.SEEK_SET, shm.LOCK_DAEMON, 1, 0)
        try:
            answer = fcntl.fcntl(self._fd, fcntl.F_OFD_GETLK, ask)
        except OSError:
            return True  # an answer that cannot be had is no proof of death
        return bool(binary.unpack(_FLOCK, answer)[0] != fcntl.F_UNLCK)

    def damaged(self, what: str) -> StateError:
        """The error that something in the segment makes no sense."""
        return StateError(
            f"the shared memory of bus '{self._bus}' is damaged ({what}); restart the daemon"
        )

    def _starting(self) -> UnreachableError:
        return UnreachableError(f"the daemon of bus '{self._bus}' is still starting")


def _version(layout: int) -> str:
    return f"{layout >> 16}.{layout & 0xFFFF}"


def _histogram(raw: Any) -> Histogram:
    buckets = tuple(array.array("Q", bytes(raw.buckets)))
    smallest = 0 if raw.min_ns == _NONE else raw.min_ns
    return Histogram(buckets, raw.sum_ns, smallest, raw.max_ns)


def printable(raw: bytes) -> str:
    """Text that can be shown: of a damaged segment it may hold anything."""
    text = raw.decode("utf-8", "replace")
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)
