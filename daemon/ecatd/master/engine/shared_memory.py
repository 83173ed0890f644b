"""Creates the two shared memory objects of a bus and fills their tables.

The shared memory gets its name as soon as it is locked, the `.out` shared memory when it is
complete. The kernel releases the lock when the process ends. So shared memory without a lock was
left behind by a daemon that was killed, and is replaced.
"""

from __future__ import annotations

import ctypes
import errno
import mmap
import os
import stat
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import accumulate
from pathlib import Path
from typing import Any

from ecatd.base.errors import EcatError, NotPermittedError, StateError
from ecatd.base.file_locks import take
from ecatd.base.paths import give_to_group
from ecatd.base.version import VERSION
from ecatd.config.resolve.can import CanChannel
from ecatd.description.bus import Bus
from ecatd.shm import contract as shm
from ecatd.shm.files import MEMORY, already_served, may_own

from .engine import Grant, publish_layout
from .process_image import Image

_PAGE = 4096

SHM_MODE, OUT_MODE = 0o640, 0o660
"""File modes: members of the group may read the bus, and write into `.out`."""


class SharedMemory:
    """The shared memory objects of one bus, created and owned by this process.

    The constructor reserves the name of the bus, before anything is done to the slaves. `fill`
    gives the shared memory its size and content, and `publish` lets clients in.

    Attributes:
        address: Address of the header in this process, for the engine.
        path: Path of the shared memory.
        out_path: Path of the `.out` shared memory.
        fd: File descriptor of the shared memory.
        out_fd: File descriptor of the `.out` shared memory.
        out: `ecat_out_header`, a copy of what was written.
        header: `ecat_shm_header`, mapped: clients see every assignment at once. So they do with
            the tables below.
        slaves: `ecat_shm_slave` table.
        signals: `ecat_shm_signal` table.
        slave_status: `ecat_shm_slave_status` table.
        slot_status: `ecat_shm_slot_status` table.
        domains: `ecat_shm_domain` table.
        can: `ecat_shm_can` table.
        can_senders: `ecat_shm_can_sender` table.
        settings: `ecat_shm_setting` table.
        health: `ecat_shm_health`.

    Raises:
        StateError: Another daemon serves a bus of this name.
        NotPermittedError: A file of another user has the name, and cannot be replaced.
    """

    def __init__(self, bus: str, folder: Path) -> None:
        self.path = folder / bus
        self.out_path = folder / f"{bus}.out"
        self.out_fd = -1
        self.header: Any = None
        self._name = bus
        with _explained(self.path):
            self.fd = _create(folder, SHM_MODE)
            take(self.fd, shm.LOCK_DAEMON)
            self._put_in_place()

    def fill(
        self,
        bus: Bus,
        image: Image,
        lease_ns: int,
        lease_max_ns: int,
        channels: Sequence[CanChannel] = (),
    ) -> None:
        """Lays out and fills the tables and pages of a bus.

        Args:
            bus: The bus description.
            image: Its process image.
            lease_ns: Shortest lease, in ns.
            lease_max_ns: Longest lease that a client can ask for, in ns.
            channels: The CAN channels.

        Raises:
            EcatError: There is not enough memory, or a file cannot be made.
        """
        self._bus = bus
        self._image = image
        instance = time.time_ns()
        plan = _Plan(bus, image, channels)
        with _explained(self.path, plan.size):
            os.posix_fallocate(self.fd, 0, plan.size)
            self._map = mmap.mmap(self.fd, plan.size)
            self._fill(plan, instance, lease_ns, lease_max_ns)
        with _explained(self.out_path):
            self.out_fd = _create(self.out_path.parent, OUT_MODE)
            self._fill_out(instance)
            self.out_path.unlink(missing_ok=True)  # of a daemon that was killed
            _name(self.out_fd, self.out_path)

    def _at(self, name: str, offset: int, count: int = 1) -> Any:
        kind = shm.struct(name)
        return (kind * count if count != 1 else kind).from_buffer(self._map, offset)

    def _fill(self, plan: _Plan, instance: int, lease_ns: int, lease_max_ns: int) -> None:
        bus, header = self._bus, self._at("ecat_shm_header", 0)
        self.header = header
        self.address = ctypes.addressof(header)
        header.magic = shm.SHM_MAGIC
        header.state = shm.BusState.STARTING
        header.size = plan.size
        header.instance = instance
        header.fingerprint = bus.fingerprint
        header.cycle_time_ns = bus.cycle_time_us * 1000
        header.lease_ns = lease_ns
        header.lease_max_ns = lease_max_ns
        header.pid = os.getpid()
        for key in ("slave_count", "signal_count", "domain_count", "slot_count", "can_count"):
            setattr(header, key, getattr(plan, key))
        header.output_bytes = self._image.output_bytes
        header.bus = bus.name.encode()
        header.version = VERSION.encode()[:15]
        for key, offset in plan.offsets.items():
            setattr(header, f"{key}_offset", offset)
        settings = shm.struct("ecat_shm_setting") * len(shm.Setting)
        self.settings = settings.from_buffer(self._map, plan.offsets["settings"])
        self.health = self._at("ecat_shm_health", plan.offsets["health"])
        slots = shm.struct("ecat_shm_slot_status") * plan.slot_count
        self.slot_status = slots.from_buffer(self._map, plan.offsets["slot_status"])
        self._fill_slaves(plan)
        self._fill_signals(plan)
        self._fill_domains(plan)
        self._fill_can(plan)

    def _fill_slaves(self, plan: _Plan) -> None:
        count = max(1, len(self._bus.slaves))
        # `_at` gives a plain struct for one entry; these are arrays always, so that they can be
        # indexed.
        kind = shm.struct("ecat_shm_slave") * count
        self.slaves = table = kind.from_buffer(self._map, plan.offsets["slaves"])
        status = shm.struct("ecat_shm_slave_status") * count
        self.slave_status = status.from_buffer(self._map, plan.offsets["slave_status"])
        for row, slave in zip(table, self._bus.slaves, strict=False):
            for key in ("vendor", "product", "revision", "serial", "position", "alias"):
                setattr(row, key, getattr(slave, key))
            for key in ("dc_bits", "dc_delay_ns", "sync0_ns", "sync1_ns", "sync_shift_ns"):
                setattr(row, key, getattr(slave, key))
            row.address = slave.address
            row.domain = slave.domain
            row.output_offset, row.output_bytes = slave.output_offset, slave.output_bytes
            row.input_offset, row.input_bytes = slave.input_offset, slave.input_bytes
            row.signals_first, row.signals_count = plan.ranges[slave.position]
            groups = self._image.domains[slave.domain].groups
            row.group = groups.index(slave.group) if slave.group else -1
            row.name = _text(slave.given_name or slave.name, 64)

    def _fill_signals(self, plan: _Plan) -> None:
        kind = shm.struct("ecat_shm_signal") * max(1, len(plan.signals))
        self.signals = table = kind.from_buffer(self._map, plan.offsets["signals"])
        sources = shm.struct("ecat_shm_output") * max(1, len(plan.signals))
        self.outputs = sources.from_buffer(self._map, plan.offsets["outputs"])
        self._entries = [entry for _, _, entry, _, _ in plan.signals]
        for row, (slave, pdo, entry, output, bit_offset) in zip(table, plan.signals, strict=False):
            row.slave, row.domain = slave.position, slave.domain
            row.index, row.subindex, row.output = entry.index, entry.subindex, int(output)
            row.type, row.bit_length = entry.data_type, entry.bit_length
            row.bit_offset = bit_offset
            row.scale, row.offset = entry.scale, entry.offset
            row.pdo, row.pdo_name = pdo.index, _text(pdo.name, 64)
            row.name, row.unit = _text(entry.name or pdo.name, 64), _text(entry.unit, 16)
        self.set_limits()

    def _fill_domains(self, plan: _Plan) -> None:
        kind = shm.struct("ecat_shm_domain") * len(self._image.domains)
        self.domains = table = kind.from_buffer(self._map, plan.offsets["domains"])
        for row, domain, page in zip(table, self._image.domains, plan.pages, strict=True):
            row.name = _text(domain.name, 32)
            row.page_offset = page
            row.image_bytes = domain.output_bytes + domain.input_bytes
            row.output_bytes = domain.output_bytes
            row.output_base = domain.output_base
            row.divider, row.phase = domain.divider, domain.phase
            row.wkc_expected = domain.wkc_expected
        status = shm.struct("ecat_shm_domain_status") * len(self._image.domains)
        self.domain_status = status.from_buffer(self._map, plan.offsets["domain_status"])

    def _fill_can(self, plan: _Plan) -> None:
        kind = shm.struct("ecat_shm_can") * max(1, plan.can_count)
        self.can = table = kind.from_buffer(self._map, plan.offsets["can"])
        senders = shm.struct("ecat_shm_can_sender") * max(1, plan.slot_count * plan.can_count)
        self.can_senders = senders.from_buffer(self._map, plan.offsets["can_senders"])
        for row, channel, records in zip(table, plan.channels, plan.records, strict=False):
            row.slave = channel.slave
            row.identifier_bits, row.bit_rate = channel.identifiers, 1000 * channel.bit_rate
            row.receive_queue, row.send_queue = channel.receive_queue, channel.send_queue
            row.records_offset = records

    def _fill_out(self, instance: int) -> None:
        header = shm.struct("ecat_out_header")()
        header.magic = shm.OUT_MAGIC
        header.layout = shm.LAYOUT
        header.slot_count = shm.SLOTS
        header.instance = instance
        header.doorbells_offset = _PAGE
        header.slots_offset = 2 * _PAGE
        header.claims_offset = _up(
            shm.size("ecat_out_slot") + shm.REQUESTS * shm.size("ecat_out_request"), 64
        )
        claims = _up(self.header.signal_count, 64) // 8
        header.images_offset = _up(header.claims_offset + claims, 64)
        mask_and_values = 2 * _up(self._image.output_bytes, 8)
        header.image_stride = _up(shm.size("ecat_out_image") + mask_and_values, 64)
        header.can_offset = header.images_offset + shm.IMAGES * header.image_stride
        headers = self.header.can_count * shm.size("ecat_out_can")
        header.can_queues_offset = _up(header.can_offset + headers, 64)
        queue = shm.CAN_QUEUE * shm.size("ecat_out_can_frame")
        end = header.can_queues_offset + self.header.can_count * queue
        header.slot_stride = _up(end, _PAGE)
        size = header.slots_offset + shm.SLOTS * header.slot_stride
        with _explained(self.out_path, size):
            os.posix_fallocate(self.out_fd, 0, size)
        os.pwrite(self.out_fd, bytes(header), 0)
        self.out = header

    def _put_in_place(self) -> None:
        """Gives the shared memory its name; raises `StateError` if a living daemon has it."""
        while True:
            try:
                _name(self.fd, self.path)
            except FileExistsError:
                self._remove_leftover()
            else:
                return

    def _remove_leftover(self) -> None:
        try:
            found = self.path.lstat()
            if not stat.S_ISREG(found.st_mode) or not may_own(found.st_uid):
                self.path.unlink()  # no daemon makes such a file
                return
            flags = os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK  # a FIFO must not wait
            old = os.open(self.path, os.O_RDWR | flags)
        except FileNotFoundError:
            return
        except IsADirectoryError:
            raise  # `_explained` says it
        except OSError as error:
            raise NotPermittedError(
                f"{self.path} belongs to another user and cannot be replaced ({error.strerror}); "
                f"if an ecatd of that user runs, give this bus another name with --bus; else have "
                f"its owner remove the file"
            ) from error
        try:
            if not take(old, shm.LOCK_DAEMON):
                raise already_served(self._name, old)
            with suppress(FileNotFoundError):
                if self.path.stat().st_ino == os.fstat(old).st_ino:
                    self.path.unlink()
        finally:
            os.close(old)

    def set_grants(self, grants: Iterable[Grant]) -> None:
        """Writes to the `settings` table which real-time settings the system has granted."""
        for grant in grants:
            row = self.settings[grant.setting]
            row.wanted, row.value, row.error = int(grant.wanted), grant.value, grant.error
            row.granted = int(grant.wanted and grant.error == 0)

    def set_leases(self, shortest_ns: int, longest_ns: int) -> None:
        """Changes the leases. A client keeps the lease that it has until it claims again."""
        self.header.lease_ns, self.header.lease_max_ns = shortest_ns, longest_ns

    def set_limits(self) -> None:
        """Writes the limits of all entries as the bus description has them now.

        Clients that have connected already go on with those that they have read.
        """
        for row, entry in zip(self.signals, self._entries, strict=False):
            row.minimum, row.maximum = entry.raw_range()

    def publish(self) -> None:
        """Lets clients in: writes the layout version, which is the last word to be written."""
        publish_layout(self.address)

    def set_state(self, state: shm.BusState) -> None:
        """Publishes what the daemon is doing. Before `fill` it does nothing."""
        if self.header is not None:
            self.header.state = state

    def close(self) -> None:
        """Tells clients that the daemon has stopped, and removes the names."""
        self.set_state(shm.BusState.STOPPED)
        if self.out_fd >= 0:
            _remove(self.out_fd, self.out_path)
            os.close(self.out_fd)
        # The name goes before the lock, so that nobody finds unlocked shared memory of ours.
        _remove(self.fd, self.path)
        os.close(self.fd)


class _Plan:
    """The signals of a bus, and where tables and pages lie in the shared memory."""

    def __init__(self, bus: Bus, image: Image, channels: Sequence[CanChannel]) -> None:
        self.channels = channels
        self.signals = [
            (
                slave,
                pdo,
                entry,
                output,
                8 * (slave.output_offset if output else slave.input_offset) + bit,
            )
            for slave in bus.slaves
            for output in (True, False)
            for pdo, entry, bit in slave.entries(outputs=output)
            if entry.bit_length <= 64
        ]
        counts = Counter(slave.position for slave, *_ in self.signals)
        ends = list(accumulate(counts[slave.position] for slave in bus.slaves))
        self.ranges = [
            (end - counts[slave.position], counts[slave.position])
            for slave, end in zip(bus.slaves, ends, strict=True)
        ]
        self.size = _up(shm.size("ecat_shm_header"), 64)
        self.slave_count, self.signal_count = len(bus.slaves), len(self.signals)
        self.domain_count, self.slot_count = len(image.domains), shm.SLOTS
        self.can_count = len(channels)
        self.offsets = {
            name: self._place(table.struct, table.count(self)) for name, table in shm.TABLES.items()
        }
        self.pages = []
        for domain in image.domains:
            self.pages.append(self.size)
            data = _up(domain.output_bytes + domain.input_bytes, 8)
            self.size = _up(self.size + shm.size("ecat_shm_page") + data, 64)

        self.records = [
            self._place("ecat_shm_can_record", shm.CAN_RECORDS) for _ in range(self.can_count)
        ]

    def _place(self, name: str, count: int) -> int:
        at = self.size
        self.size = _up(at + shm.size(name) * max(1, count), 64)
        return at


def _up(value: int, step: int) -> int:
    return -(-value // step) * step


def _text(text: str, room: int) -> bytes:
    """Encodes text as UTF-8 of less than `room` bytes, so that a NUL fits; cuts no character."""
    data = text.replace("\0", " ").encode("utf-8", "replace")[: room - 1]
    return data.decode("utf-8", "ignore").encode()


def _create(folder: Path, mode: int) -> int:
    """Creates a file without a name, so that nobody finds it unfinished.

    If this process is killed before it names the file, the kernel removes it.
    """
    fd = os.open(folder, os.O_RDWR | os.O_TMPFILE | os.O_CLOEXEC, mode)
    os.fchmod(fd, mode)  # whatever the umask is
    give_to_group(fd)
    return fd


def _name(fd: int, path: Path) -> None:
    """Gives a file without a name its name.

    Raises:
        FileExistsError: The name is taken.
    """
    # Python sets AT_SYMLINK_FOLLOW only if a directory descriptor is given, too.
    folder = os.open("/proc/self/fd", os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.link(str(fd), path, src_dir_fd=folder, follow_symlinks=True)
    finally:
        os.close(folder)


def has_name(fd: int, path: Path) -> bool:
    """Whether `path` still names the open file `fd`.

    Raises:
        FileNotFoundError: There is no file of this name.
    """
    named, found = path.lstat(), os.fstat(fd)
    return (named.st_dev, named.st_ino) == (found.st_dev, found.st_ino)


def _remove(fd: int, path: Path) -> None:
    """Removes the name of a file, unless the name belongs to another file by now."""
    with suppress(OSError):
        if has_name(fd, path):
            path.unlink()


@contextmanager
def _explained(path: Path, size: int = 0) -> Iterator[None]:
    """Turns errors of the file system into errors of ecatd, with what to do about them."""
    try:
        yield
    except PermissionError as error:
        raise NotPermittedError(
            f"cannot make {path} ({error.strerror}): a leftover of another user is in the way; "
            f"give the bus another name, or have its owner remove it"
        ) from error
    except IsADirectoryError as error:
        raise StateError(
            f"cannot make {path}: a directory has this name; remove it, or give the bus another one"
        ) from error
    except OSError as error:
        if error.errno == errno.ENOSPC:
            need = f" of {size >> 10} KiB" if size else ""
            raise StateError(
                f"{MEMORY} is full: there is no room for {path}{need}; remove what fills it: "
                f"'du -a {MEMORY}' shows that"
            ) from error
        raise EcatError(f"cannot make {path}: {error.strerror}") from error
