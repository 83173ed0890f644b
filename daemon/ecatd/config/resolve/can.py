"""The CAN buses behind terminals: what `[slave.can]` means for a slave that was found.

`with_can_objects` adds what the terminal is told to its start-up parameters, before anything is
written; `can_channels` says what the engine exchanges, when the process data are known.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from math import floor

from ecatd.base.toml_file import Table
from ecatd.description.bus import Bus, Slave
from ecatd.etg.can_terminals import (
    EXTENDED_MAX,
    STANDARD_MAX,
    TERMINALS,
    Layout,
    Mode,
    Settings,
    Terminal,
    frames_per_second,
    frames_through,
    queue_for,
    terminal_called,
    terminal_of,
)
from ecatd.etg.datatypes import DataType, type_alias

from .. import Config, SlaveConfig, StartupConfig
from ..can import ENDED, FULL, CanSafeConfig, Range, SlaveCanConfig, ranges
from ..problems import AT_ONCE, Problems

COMMENT = "[slave.can]"
"""Comment of the start-up parameters that follow from the table."""

_TYPES = {1: DataType.UNSIGNED8, 2: DataType.UNSIGNED16, 4: DataType.UNSIGNED32}


@dataclass(frozen=True, slots=True)
class SafeFrame:
    """A frame that is sent when a sender is gone.

    Attributes:
        identifier: Its identifier.
        extended: The identifier has 29 bit.
        remote: It is a remote frame.
        data: Its bytes.
        period_ms: Milliseconds after which it is sent again; 0: it is sent once.
        senders: Senders count that have sent one of these identifiers; none: all senders.
        when_ended: It is sent also when a sender ends in order.
    """

    identifier: int
    extended: bool
    remote: bool
    data: bytes
    period_ms: int
    senders: tuple[Range, ...]
    when_ended: bool

    @classmethod
    def of(cls, safe: CanSafeConfig) -> SafeFrame:
        """The frame of a table."""
        data, ended = bytes.fromhex(safe.data), safe.when == ENDED
        return cls(
            safe.id, safe.is_extended, safe.remote, data, safe.period_ms, safe.senders, ended
        )


@dataclass(frozen=True, slots=True)
class CanChannel:
    """A CAN bus behind a terminal, as the engine exchanges it.

    Attributes:
        slave: Position of the terminal.
        terminal: What is known about it.
        layout: Its process data.
        mode: How frames go through the process data.
        bit_rate: Bit rate in kbit/s.
        cycle_us: Cycle time of its domain in µs.
        identifiers: Most bits of an identifier: 11 or 29.
        receive_queue: Most received frames in the inputs.
        send_queue: Most frames to be sent in the outputs.
        flags: Flags of the terminal.
        filters: Identifiers that it receives; none: all.
        safe: Frames that are sent when a sender is gone, in this order.
        bus_off_restart_ms: Milliseconds after which the terminal is started anew when it is
            bus-off; 0: never, or it takes part again by itself.
        remarks: Sentences about queues that are shorter than a full bus needs, and about a layout
            that is not that of the terminal.
    """

    slave: int
    terminal: Terminal
    layout: Layout
    mode: Mode
    bit_rate: int
    cycle_us: int
    identifiers: int
    receive_queue: int
    send_queue: int
    flags: int
    filters: tuple[Range, ...]
    safe: tuple[SafeFrame, ...]
    bus_off_restart_ms: int
    remarks: tuple[str, ...]

    @property
    def input_bytes(self) -> int:
        """Bytes of its inputs."""
        return self.layout.input_bytes(self.receive_queue)

    @property
    def output_bytes(self) -> int:
        """Bytes of its outputs."""
        return self.layout.output_bytes(self.send_queue)

    @property
    def status_at(self) -> int:
        """The byte of the inputs to which the fields of the status are relative."""
        return self.layout.status_at(self.receive_queue)

    @property
    def settings(self) -> Settings:
        """What the terminal is told."""
        filters = self.filters
        if not filters and self.terminal.filters and self.mode == Mode.BUFFERED:
            # One that has kept its power may have the filters of another configuration.
            filters = ((0, STANDARD_MAX if self.identifiers == 11 else EXTENDED_MAX),)
        return Settings(
            self.bit_rate,
            self.cycle_us,
            self.identifiers,
            self.receive_queue,
            self.send_queue,
            self.flags,
            filters,
        )


def can_channels(
    config: Config,
    bus: Bus,
    unknown: Collection[int] = (),
    problems: Problems = AT_ONCE,
) -> list[CanChannel]:
    """The CAN buses of a configuration, in the order of their terminals.

    Args:
        config: The configuration, about the slaves where they were found.
        bus: The bus, with the process data of its slaves.
        unknown: Positions of slaves whose process data are not known, or will change.
        problems: Takes the problems.

    Raises:
        ConfigError: A table does not fit its slave.
    """
    found = []
    for settings in sorted(config.slave, key=lambda item: item.position):
        can = settings.can
        if can is None or settings.position >= len(bus.slaves):
            continue
        with problems:
            slave = bus.slaves[settings.position]
            channel = can_channel(config, can, slave)
            if slave.position not in unknown:
                _check_lengths(can.table, channel, slave)
            _check_outputs(config, slave)
            found.append(channel)
    return found


def with_can_objects(
    config: Config, settings: SlaveConfig, slave: Slave, problems: Problems = AT_ONCE
) -> SlaveConfig:
    """Adds what the terminal is told to its start-up parameters, in front of all others.

    It is written before the PDOs are assigned, since the terminal maps them by it.

    Args:
        config: The configuration.
        settings: The table of the slave.
        slave: The slave. Its process data need not be known.
        problems: Takes the problem.

    Raises:
        ConfigError: The table does not fit the slave, or a start-up parameter contradicts it.
    """
    can = settings.can
    if can is None:
        return settings
    with problems:
        channel = can_channel(config, can, slave)
        own = list(_parameters(can.table, channel))
        indices = {item.address[0] for item in own}
        for item in settings.startup:
            if item.address[0] in indices:
                item.table.fail(
                    "object",
                    f"{item.object} of {slave.label} follows from its [slave.can]: remove this "
                    "start-up parameter, or the table",
                )
        return replace(settings, startup=[*own, *settings.startup])
    return settings


def can_change(config: Config, settings: SlaveConfig, slave: Slave) -> str:
    """What other process data a start would give a terminal; empty if it has these already.

    Raises:
        ConfigError: The table does not fit the slave.
    """
    if settings.can is None:
        return ""
    channel = can_channel(config, settings.can, slave)
    if not channel.terminal.objects or _lengths(channel) == (slave.input_bytes, slave.output_bytes):
        return ""
    return (
        f"{slave.input_bytes} bytes of inputs and {slave.output_bytes} of outputs, not "
        f"{channel.input_bytes} and {channel.output_bytes}, which follow from its [slave.can]"
    )


def can_channel(config: Config, can: SlaveCanConfig, slave: Slave) -> CanChannel:
    """What a table means for a slave.

    Raises:
        ConfigError: The terminal cannot do what the table says.
    """
    terminal = _terminal(can, slave)
    name = f"{terminal.name} ({slave.label})"
    mode = Mode(can.mode)
    if mode not in terminal.modes:
        can.table.fail("mode", f"{name} has only {_words(terminal.modes)}: write that")
    identifiers = _identifiers(can, terminal, mode, name)
    if can.bit_rate not in terminal.bit_rates:
        rates = ", ".join(map(str, sorted(terminal.bit_rates)))
        can.table.fail("bit_rate", f"{name} cannot do {can.bit_rate} kbit/s: write one of {rates}")
    _check_sample_point(can, terminal, name)
    if can.filters and not terminal.filters:
        can.table.fail("filters", f"{name} has no filters: leave them out")
    cycle_us = _cycle_us(config, slave.position)
    receive, send, short = _Queues(can, terminal, mode, cycle_us, identifiers, slave).lengths()
    return CanChannel(
        slave=slave.position,
        terminal=terminal,
        layout=terminal.layouts[identifiers],
        mode=mode,
        bit_rate=can.bit_rate,
        cycle_us=cycle_us,
        identifiers=identifiers,
        receive_queue=receive,
        send_queue=send,
        flags=_flags(can, terminal, mode, identifiers, name),
        filters=ranges(can.filters),
        safe=tuple(map(SafeFrame.of, can.safe)),
        bus_off_restart_ms=0 if terminal.recovers else can.bus_off_restart_ms,
        remarks=tuple(text for text in (_other_layout(can, terminal, slave), short) if text),
    )


def _terminal(can: SlaveCanConfig, slave: Slave) -> Terminal:
    """The terminal that a slave is, or like which it behaves."""
    if can.layout is not None:
        known = terminal_called(can.layout)
        assert known is not None, "checked when the configuration was read"
    else:
        known = terminal_of(slave.vendor, slave.product)
    if known is None:
        names = ", ".join(f'"{item.key}" ({item.name})' for item in TERMINALS)
        can.table.fail(
            None,
            f"{slave.label} (vendor 0x{slave.vendor:08X}, product 0x{slave.product:08X}) is no "
            f"known CAN terminal: if it behaves like one of {names}, write its word as layout; "
            "else remove the table",
        )
    if known.objects and not slave.coe:
        can.table.fail(
            None, f"{slave.label} has no CoE, so nothing can be set in it: remove the table"
        )
    return known


def _other_layout(can: SlaveCanConfig, terminal: Terminal, slave: Slave) -> str:
    """Says that a terminal that is known is used like another one; else empty."""
    known = terminal_of(slave.vendor, slave.product)
    if known is None or known is terminal:
        return ""
    return (
        f"{can.table.where('layout')}: {slave.label} is the terminal {known.name}, but ecatd uses "
        f'it like {terminal.name}, as layout = "{terminal.key}" says: leave layout out unless it '
        "behaves like that"
    )


def _identifiers(can: SlaveCanConfig, terminal: Terminal, mode: Mode, name: str) -> int:
    usual = 11 if mode != Mode.BUFFERED or 29 not in terminal.layouts else 29
    wanted = usual if can.identifiers is None else can.identifiers
    if wanted not in terminal.layouts:
        has = " or ".join(map(str, terminal.layouts))
        can.table.fail("identifiers", f"{name} has only {has} bit, not {wanted}: leave this out")
    return wanted


def _check_sample_point(can: SlaveCanConfig, terminal: Terminal, name: str) -> None:
    if can.sample_point is None:
        return
    there = terminal.sample_points.get(can.bit_rate)
    if there is None:
        can.table.fail(
            "sample_point",
            f"nothing says where {name} samples a bit, and it cannot be set: leave this out",
        )
    if there != can.sample_point:
        can.table.fail(
            "sample_point",
            f"is {can.sample_point:g}, but {name} samples at {there:g} % at {can.bit_rate} kbit/s, "
            "and cannot be told otherwise: set the other nodes to that, or choose another bit rate",
        )


def _flags(can: SlaveCanConfig, terminal: Terminal, mode: Mode, identifiers: int, name: str) -> int:
    if can.flags is not None:
        if not terminal.flags:
            can.table.fail("flags", f"{name} has no flags: leave them out")
        return can.flags
    known = terminal.flags.get((mode, identifiers))
    if known is None and terminal.flags:
        can.table.fail(
            "flags",
            f'is missing: nothing says which flags choose mode = "{mode}" in {name}. TwinCAT '
            "writes them to object 0x8000:20 when it starts such a terminal: write the same",
        )
    return known or 0


def _words(modes: Sequence[Mode]) -> str:
    return ", ".join(f'"{mode}"' for mode in modes)


def _cycle_us(config: Config, position: int) -> int:
    """The cycle time of the domain of a slave."""
    there = [item for item in config.domain if position in item.slaves] or config.domain[:1]
    return config.cycle_time_us * (there[0].divider if there else 1)


class _Queues:
    """Computes the lengths of the queues, and refuses those that do not fit."""

    def __init__(
        self,
        can: SlaveCanConfig,
        terminal: Terminal,
        mode: Mode,
        cycle_us: int,
        identifiers: int,
        slave: Slave,
    ) -> None:
        self._can, self._terminal, self._mode, self._cycle_us = can, terminal, mode, cycle_us
        self._identifiers = identifiers
        self._name = f"{terminal.name} ({slave.label})"
        self._full = frames_per_second(can.bit_rate)
        asked = can.frames_per_second
        self._asked = isinstance(asked, int) or asked == FULL
        self._frames = float(asked) if isinstance(asked, int) else self._full
        self._need = queue_for(self._frames, cycle_us, mode)

    def lengths(self) -> tuple[int, int, str]:
        """The lengths of both queues, and a remark if a full bus needs longer ones."""
        if self._frames > self._full:
            self._can.table.fail(
                "frames_per_second",
                f"is {self._frames:g}, but a bus of {self._can.bit_rate} kbit/s carries at most "
                f"{self._full:.0f} frames a second: write fewer, or a higher bit_rate",
            )
        most = self._terminal.queue_max
        if self._asked and self._need > most:
            self._can.table.fail("frames_per_second", f"{self._calculation()}: {self._remedies()}")
        receive = self._length("receive_queue", min(self._need, most))
        send = self._length("send_queue", receive)
        shorter = min(receive, send)
        if self._asked or shorter >= queue_for(self._full, self._cycle_us, self._mode):
            return receive, send, ""
        carried = floor(frames_through(shorter, self._cycle_us, self._mode))
        return (
            receive,
            send,
            f"{self._can.table.where('bit_rate')}: the queues of {self._name} carry {carried} "
            f"frames a second each way, and a full bus of {self._can.bit_rate} kbit/s up to "
            f"{self._full:.0f}: write frames_per_second = {carried} or fewer if that is enough; "
            f"else {self._remedies()}",
        )

    def _length(self, key: str, usual: int) -> int:
        given: int | None = getattr(self._can, key)
        most = self._terminal.queue_max
        if self._terminal.queue_fixed:
            if given not in (None, most):
                self._can.table.fail(
                    key, f"is {given}, but {self._name} always has {most}: leave this out"
                )
            return most
        if given is None:
            return usual
        if given > most:
            self._can.table.fail(
                key, f"is {given}, but {self._name} has at most {most}: write fewer"
            )
        if self._asked and given < self._need:
            self._can.table.fail(
                key, f"is {given}, but {self._calculation()}: leave this out, or write fewer frames"
            )
        return given

    def _calculation(self) -> str:
        cycles = self._mode.cycles
        text = (
            f"{self._frames:.0f} frames a second and a batch every {cycles} "
            f"cycle{'s' * (cycles > 1)} of {self._cycle_us} µs need a queue of {self._need}"
        )
        most = self._terminal.queue_max
        return f"{text}, and {self._name} has at most {most}" if self._need > most else text

    def _remedies(self) -> str:
        return "; or ".join(self._ways()) or "choose another terminal"

    def _ways(self) -> Iterator[str]:
        """What would make the queue long enough."""
        most, cycles = self._terminal.queue_max, self._mode.cycles
        cycle_us = floor(most * 1e6 / (self._frames * cycles))
        if cycle_us < self._cycle_us:
            yield f"exchange it every {cycle_us} µs or more often"
        for mode in self._terminal.modes:
            free = self._identifiers == 11 or self._can.identifiers is None
            fits = queue_for(self._frames, self._cycle_us, mode) <= most
            if mode.cycles < cycles and fits and free and not self._can.filters:
                yield f'write mode = "{mode}" (identifiers of 11 bit, no filters)'
                break
        if not isinstance(self._can.frames_per_second, int):
            rates = [
                rate
                for rate in self._terminal.bit_rates
                if rate < self._can.bit_rate
                and queue_for(frames_per_second(rate), self._cycle_us, self._mode) <= most
            ]
            if rates:
                yield f"write bit_rate = {max(rates)} or less"
        if self._asked:
            fewer = floor(frames_through(most, self._cycle_us, self._mode))
            yield f"write frames_per_second = {fewer} or fewer"


def _parameters(table: Table, channel: CanChannel) -> Iterator[StartupConfig]:
    for item in channel.terminal.written(channel.settings):
        parameter = StartupConfig(
            f"0x{item.index:04X}:{item.subindex:02X}",
            complete=item.complete,
            transition="IP",
            comment=COMMENT,
            table=table,
        )
        if item.complete:
            parameter.hex = item.data.hex(" ").upper()
        else:
            parameter.type = type_alias(_TYPES[len(item.data)])
            parameter.value = str(int.from_bytes(item.data, "little"))
        yield parameter


def _lengths(channel: CanChannel) -> tuple[int, int]:
    return channel.input_bytes, channel.output_bytes


def _check_lengths(table: Table, channel: CanChannel, slave: Slave) -> None:
    """Compares the process data that the slave has with those of the layout."""
    there = slave.input_bytes, slave.output_bytes
    if there == _lengths(channel):
        return
    layout = channel.layout
    status = f" and {layout.status.size} of status" if layout.status.size else ""
    told = ""
    if not channel.terminal.objects:
        told = ". ecatd cannot set this terminal: set it with [[slave.startup]] and pdos"
    table.fail(
        None,
        f"{slave.label} exchanges {there[0]} bytes of inputs and {there[1]} of outputs, but those "
        f"of {channel.terminal.name} with identifiers of {channel.identifiers} bit have "
        f"{channel.input_bytes} (receive_queue = {channel.receive_queue} frames of "
        f"{layout.received.stride} bytes behind {layout.received.first}{status}) and "
        f"{channel.output_bytes} (send_queue = {channel.send_queue} frames of "
        f"{layout.sent.stride} behind {layout.sent.first}). Which of both is right is not known, "
        f"so nothing is exchanged: check pdos, layout and flags of the slave{told}",
    )


def _check_outputs(config: Config, slave: Slave) -> None:
    """Refuses tables that would write the outputs, which belong to ecatd."""
    text = f"the outputs of {slave.label} belong to its [slave.can]: remove one of them"
    for safe in config.outputs.safe:
        if safe.slave == slave.position:
            safe.table.fail("slave", text)
    for copy in config.copy:
        if copy.slave == slave.position:
            copy.table.fail("slave", text)
