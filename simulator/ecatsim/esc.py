"""The C library of slave controllers (simulator/esc/esc.h), wrapped in one Python class."""

from __future__ import annotations

import ctypes
import errno
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntFlag
from functools import cache

from ecatd.base.errors import EcatError, NotPermittedError, StateError, UnreachableError, UsageError
from ecatd.base.native import load

from . import clocks, links
from .chip import Chip, Config, config
from .clocks import Clock, Clocks
from .links import (
    MAX_FAULTS,
    MAX_SLAVES,
    FaultKind,
    FrameFault,
    InjectedFault,
    Links,
    Passage,
    checked,
)
from .net import netlink

__all__ = [
    "MAX_FAULTS",
    "MAX_SLAVES",
    "Area",
    "Chip",
    "Clock",
    "Counters",
    "Event",
    "FaultKind",
    "FrameFault",
    "InjectedFault",
    "Passage",
    "Segment",
]

_MAX_MAIL = 2048
_MAX_EVENTS = 256


class Event(IntFlag):
    """Events of a slave (enum esc_event_bits)."""

    AL_CONTROL = 0x01
    MAILBOX_IN = 0x02
    MAILBOX_OUT = 0x04
    MAILBOX_AGAIN = 0x08
    OUTPUTS = 0x10
    WATCHDOG = 0x20
    EEPROM = 0x40
    RESET = 0x80
    SYNC0 = 0x100
    SYNC1 = 0x200


@dataclass(frozen=True, slots=True)
class Area:
    """The place of the process data of one sync manager.

    Attributes:
        output: Whether they are outputs rather than inputs.
        address: First byte in the memory of the slave.
        size: Size in bytes.
        offset: First byte in the image of all outputs, or of all inputs, of the segment.
    """

    output: bool
    address: int
    size: int
    offset: int


@dataclass(frozen=True, slots=True)
class Counters:
    """Counters of a segment since it was made.

    Attributes:
        frames: Frames answered.
        malformed: Frames whose lengths contradict each other.
        dropped: Frames that did not come back: because of faults, open or broken links, or no
            slaves.
        cycles: Cycles of process data that have begun; see `FrameFault`.
    """

    frames: int
    malformed: int
    dropped: int
    cycles: int


class _Event(ctypes.Structure):
    _fields_ = (("position", ctypes.c_uint32), ("bits", ctypes.c_uint32))


class _Area(ctypes.Structure):
    _fields_ = (
        ("address", ctypes.c_uint16),
        ("size", ctypes.c_uint16),
        ("offset", ctypes.c_uint32),
        ("output", ctypes.c_uint32),
    )


class _Counters(ctypes.Structure):
    _fields_ = (
        ("frames", ctypes.c_uint64),
        ("malformed", ctypes.c_uint64),
        ("dropped", ctypes.c_uint64),
        ("cycles", ctypes.c_uint64),
    )


@cache
def _library() -> ctypes.CDLL:
    lib = load("ecatsim", "ecat_esc")
    segment, number, size = ctypes.c_void_p, ctypes.c_int, ctypes.c_size_t
    data, address = ctypes.c_char_p, ctypes.c_uint16
    functions: dict[str, tuple[type | None, list[type]]] = {
        **links.signatures(),
        **clocks.signatures(),
        "esc_add_slave": (number, [segment, ctypes.POINTER(Config), data, size]),
        "esc_replace": (number, [segment, number, ctypes.POINTER(Config), data, size]),
        "esc_create": (segment, []),
        "esc_destroy": (None, [segment]),
        "esc_start": (number, [segment, data, data]),
        "esc_stop": (number, [segment]),
        "esc_wait": (number, [segment, ctypes.c_int64, ctypes.POINTER(_Event), number]),
        "esc_read": (number, [segment, number, address, ctypes.c_void_p, size]),
        "esc_peek": (number, [segment, number, address, ctypes.c_void_p, size]),
        "esc_write": (number, [segment, number, address, data, size]),
        "esc_set_carrier": (number, [segment, number, number]),
        "esc_reopen": (number, [segment, number, ctypes.c_char_p]),
        "esc_set_al_status": (number, [segment, number, address, address]),
        "esc_lock_sync_manager": (number, [segment, number, number, number]),
        "esc_mailbox_take": (number, [segment, number, ctypes.c_void_p, size]),
        "esc_mailbox_put": (number, [segment, number, data, size, number]),
        "esc_set_program": (number, [segment, number, ctypes.c_void_p, ctypes.c_void_p]),
        "esc_map": (number, [segment, number, ctypes.POINTER(_Area), ctypes.c_uint]),
        "esc_await_outputs": (number, [segment, number]),
        "esc_get_outputs": (number, [segment, ctypes.c_void_p, size, ctypes.c_int64]),
        "esc_put_inputs": (number, [segment, ctypes.c_void_p, size]),
        "esc_refused_fmmus": (number, [segment, number]),
        "esc_sii": (number, [segment, number, ctypes.c_void_p, size]),
        "esc_set_sii": (number, [segment, number, data, size]),
        "esc_get_counters": (None, [segment, ctypes.POINTER(_Counters)]),
    }
    for name, (result, arguments) in functions.items():
        function = getattr(lib, name)
        function.restype = result
        function.argtypes = arguments
    return lib


class Segment(Links, Clocks):
    """The slave controllers behind one interface, or in a ring between two interfaces.

    The controllers run in C; this class is their process data interface (PDI). All methods are
    thread-safe, except that `close` must be the last call.
    """

    def __init__(self) -> None:
        self._lib = _library()
        self._pointer = self._lib.esc_create()
        if not self._pointer:
            raise EcatError("not enough memory or file descriptors for a segment")
        self._events = (_Event * _MAX_EVENTS)()
        self._mail = ctypes.create_string_buffer(_MAX_MAIL)
        self._images: tuple[object, object] = (None, None)
        self._carriers: dict[str, bool] = {}
        self._indices: dict[str, int] = {}
        self._interfaces: netlink.Interfaces | None = None
        self.outputs = memoryview(b"")
        self.inputs = memoryview(b"")

    def close(self) -> None:
        """Stops the segment and frees it."""
        self._close_interfaces()
        if self._pointer:
            self._lib.esc_destroy(self._pointer)
            self._pointer = None

    def add(self, chip: Chip, sii: bytes) -> int:
        """Appends a slave and returns its position.

        The first slave is at the first interface. Port 0 of each other slave is plugged into port 1
        of the slave added before, if that port exists and is free; `connect` moves it.

        Raises:
            UsageError: A property of the chip is not allowed, or the segment is full.
        """
        result: int = self._lib.esc_add_slave(self._handle, config(chip), sii, len(sii))
        if result == -errno.ENOSPC:
            raise UsageError(f"a segment has at most {MAX_SLAVES} slaves")
        return checked(result)

    def replace(self, slave: int, chip: Chip, sii: bytes) -> None:
        """Replaces a slave by another one at the same links; the new one powers on.

        Links at ports that the new chip lacks stay down.

        Raises:
            UsageError: There is no such slave, or a property of the chip is not allowed.
        """
        result = self._lib.esc_replace(self._handle, slave, config(chip), sii, len(sii))
        self.check_slave(result, slave)

    def start(self, interface: str, second: str | None = None) -> None:
        """Starts a thread that serves an Ethernet interface, or the two of a ring.

        Raises:
            UnreachableError: There is no such interface.
            NotPermittedError: The process is not permitted to open raw sockets.
            StateError: The segment serves an interface already.
        """
        other = None if second is None else second.encode()
        interfaces = (interface,) if second is None else (interface, second)
        self._carriers = dict.fromkeys(interfaces, True)
        self._close_interfaces()
        self._interfaces = netlink.Interfaces()
        self._indices = {name: self._interfaces.index(name) for name in interfaces}
        result = self._lib.esc_start(self._handle, interface.encode(), other)
        names = interface if second is None else f"{interface}' or '{second}"
        if result in (-errno.ENODEV, -errno.ENXIO):
            raise UnreachableError(f"there is no network interface '{names}'")
        if result in (-errno.EPERM, -errno.EACCES):
            raise NotPermittedError(
                f"raw sockets on '{names}' need CAP_NET_RAW: run as root, "
                "or leave --interface out to serve a private interface"
            )
        if result == -errno.EALREADY:
            raise StateError("the segment already serves an interface")
        checked(result)

    def follow_carriers(self) -> None:
        """Opens and closes the links to the interfaces when their carriers come and go.

        Serves an interface again that was deleted and made again; the slaves see the same link.
        """
        if self._interfaces is None:
            return
        for number, (interface, before) in enumerate(list(self._carriers.items())):
            index = self._interfaces.index(interface)
            made_again = index not in (0, self._indices[interface])
            # If reopening fails, the interface has vanished again. A later call tries again.
            if made_again and self._lib.esc_reopen(self._handle, number, interface.encode()) == 0:
                self._indices[interface] = index
            now = self._interfaces.has_carrier(interface)
            if now != before:
                self._carriers[interface] = now
                checked(self._lib.esc_set_carrier(self._handle, number, now))

    def stop(self) -> None:
        """Stops serving the interface."""
        self._carriers = {}
        checked(self._lib.esc_stop(self._handle))

    def _close_interfaces(self) -> None:
        if self._interfaces is not None:
            self._interfaces.close()
            self._interfaces = None

    def wait(self, seconds: float) -> list[tuple[int, Event]]:
        """Waits for events at most `seconds`; returns pairs of position and events, or none."""
        count = self._lib.esc_wait(
            self._handle, max(0, int(seconds * 1e9)), self._events, _MAX_EVENTS
        )
        if count == -errno.EINTR:
            return []
        return [(event.position, Event(event.bits)) for event in self._events[: checked(count)]]

    def read(self, position: int, address: int, size: int) -> bytes:
        """Reads memory of a slave as its device does; this acknowledges events."""
        buffer = ctypes.create_string_buffer(size)
        checked(self._lib.esc_read(self._handle, position, address, buffer, size))
        return buffer.raw

    def peek(self, position: int, address: int, size: int) -> bytes:
        """Reads memory of a slave as an observer, without side effects."""
        buffer = ctypes.create_string_buffer(size)
        checked(self._lib.esc_peek(self._handle, position, address, buffer, size))
        return buffer.raw

    def write(self, position: int, address: int, data: bytes) -> None:
        """Writes memory of a slave as its device does.

        Raises:
            StateError: The EEPROM interface does not belong to the device or is busy, or the
                access to a buffered sync manager does not begin at its first byte.
        """
        result = self._lib.esc_write(self._handle, position, address, data, len(data))
        if result == -errno.EACCES:
            raise StateError(
                f"slave {position} cannot write 0x{address:04X} now: begin at the first byte of a "
                "sync manager; the EEPROM interface must be idle and belong to the device"
            )
        checked(result)

    def set_al_status(self, position: int, status: int, code: int) -> None:
        """Sets AL status (register 0x0130) and AL status code (0x0134)."""
        checked(self._lib.esc_set_al_status(self._handle, position, status, code))

    def lock_sync_manager(self, position: int, channel: int, locked: bool) -> None:
        """Deactivates a sync manager, so that the master cannot access it, or releases it."""
        checked(self._lib.esc_lock_sync_manager(self._handle, position, channel, locked))

    def take_mail(self, position: int) -> bytes:
        """Takes the mail that the master has written; empty if there is none."""
        size = checked(self._lib.esc_mailbox_take(self._handle, position, self._mail, _MAX_MAIL))
        return self._mail.raw[:size]

    def put_mail(self, position: int, mail: bytes, *, again: bool = False) -> bool:
        """Puts a mail into the mailbox that the master reads.

        Args:
            position: Position of the slave.
            mail: The mail, not longer than the sync manager.
            again: Overwrite an unread mail, and acknowledge the repeat request of the master.

        Returns:
            False if the last mail is still unread.
        """
        return bool(
            checked(self._lib.esc_mailbox_put(self._handle, position, mail, len(mail), again))
        )

    def make_images(self, output_size: int, input_size: int) -> None:
        """Creates the output and input images of all slaves; sizes are in bytes."""
        buffers = tuple(ctypes.create_string_buffer(max(1, n)) for n in (output_size, input_size))
        self._images = (buffers[0], buffers[1])
        self.outputs = memoryview(buffers[0]).cast("B")[:output_size]
        self.inputs = memoryview(buffers[1]).cast("B")[:input_size]

    def map(self, position: int, areas: Sequence[Area] = ()) -> None:
        """Connects the process data of a slave to the images; no areas disconnect it."""
        rows = [_Area(area.address, area.size, area.offset, area.output) for area in areas]
        array = (_Area * len(rows))(*rows)
        checked(self._lib.esc_map(self._handle, position, array, len(rows)))

    def set_program(self, position: int, function: int, context: int) -> None:
        """Gives the process data of a slave to a function in C, instead of the images.

        Args:
            position: Position of the slave.
            function: Address of the function (`esc_program_function`).
            context: Address that it gets; it must be valid until the segment is closed, or another
                device has taken the place.
        """
        checked(self._lib.esc_set_program(self._handle, position, function, context))

    def await_outputs(self, position: int) -> None:
        """Requests `Event.OUTPUTS` as soon as the master has written complete output data.

        Only outputs since the last `map`, and since the slave last left OP, count.
        """
        checked(self._lib.esc_await_outputs(self._handle, position))

    def get_outputs(self, now_ns: int) -> None:
        """Copies the outputs of all slaves to `outputs` and runs the watchdogs up to `now_ns`.

        The outputs of a slave are zero unless it is in OP and its watchdog has not expired.
        """
        checked(self._lib.esc_get_outputs(self._handle, self._images[0], len(self.outputs), now_ns))

    def put_inputs(self) -> None:
        """Copies `inputs` to the inputs of all slaves."""
        checked(self._lib.esc_put_inputs(self._handle, self._images[1], len(self.inputs)))

    def refused_fmmus(self, position: int) -> list[int]:
        """Returns the FMMUs of a slave that are ignored, since real controllers forbid them."""
        bits = checked(self._lib.esc_refused_fmmus(self._handle, position))
        return [number for number in range(bits.bit_length()) if bits >> number & 1]

    def sii(self, position: int) -> bytes:
        """Returns the present SII image of a slave, with all changes by the master."""
        size = checked(self._lib.esc_sii(self._handle, position, None, 0))
        buffer = ctypes.create_string_buffer(size)
        checked(self._lib.esc_sii(self._handle, position, buffer, size))
        return buffer.raw

    def set_eeprom(self, position: int, image: bytes) -> None:
        """Replaces the SII image of a slave, as a programming tool would.

        The EEPROM interface (registers 0x0502 to 0x050F) returns the new image at once. The values
        that the controller loads from it change with the next reload, reset or power-on.
        """
        checked(self._lib.esc_set_sii(self._handle, position, image, len(image)))

    def counters(self) -> Counters:
        """Returns the counters of the segment."""
        counters = _Counters()
        self._lib.esc_get_counters(self._handle, counters)
        return Counters(counters.frames, counters.malformed, counters.dropped, counters.cycles)
