"""Which slaves are expected: the keys of `[[slave]]` and `[expected]`, and how they are read."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import NamedTuple

from ..bus import Module
from ..toml_file import Key, Rules, Table, array, choice, integer, number, printable, show
from .eoe import SlaveEoeConfig, read_slave_eoe
from .pdos import PdoConfig, check_pdos, read_pdo_index, read_pdos
from .placed import Placed
from .signals import NAME_BYTES
from .slave_reference import POSITION_MAX
from .startup import StartupConfig, read_parameter

STRICT, TOLERANT = "strict", "tolerant"

MAILBOX_POLL_MS = 100.0
"""Milliseconds between two looks at the mailbox of a slave, unless its table says otherwise."""

IDENTIFICATION_REGISTERS = range(0x0010, 0xFFFF)
"""Addresses in an ESC where an identification may be."""

ALIAS, ON_REQUEST = 0x0012, 0x0134
"""Registers that ESI and ENI files name for the station alias, and for an identification that the
slave tells on request, in place of the AL status code."""

_SLOTS_MAX = 254
WATCHDOG_MIN_MS, WATCHDOG_MAX_MS = 0.1, 6553.5
_POLL_MIN_MS, _POLL_MAX_MS = 10, 60_000
_NAME_BYTES = 31
_MARKS = ("alias", "identification")
_NAME = re.compile(r"[^\W\d][\w-]*")


@dataclass(slots=True)
class ModuleConfig(Placed):
    """`[[slave.module]]`: the module that a slot of a modular device shall have (ETG.5001).

    Attributes:
        slot: Number of the slot, 1 first.
        ident: Module ident.
        type: Its type, for messages.
    """

    slot: int
    ident: int
    type: str = ""


@dataclass(slots=True)
class ExpectedConfig(Placed):
    """`[expected]`: what happens if the bus is not the one that the `[[slave]]` tables describe.

    Attributes:
        policy: `STRICT`: the bus does not start; `TOLERANT`: slaves without a difference run, and
            the others take no part. A `[[slave]]` may have its own.
        unlisted: Whether slaves behind those with a `[[slave]]` are used; else each of them is a
            difference.
        description: File with the description of the complete bus, as `ecatctl scan -o` writes it:
            it says which process data optional slaves have that are not there at the start. Empty
            for none.
    """

    policy: str = STRICT
    unlisted: bool = True
    description: str = ""


class Mark(NamedTuple):
    """What tells a slave from all others wherever it stands.

    Attributes:
        kind: "station alias" or "identification".
        value: Its value, 1 to 65535.
    """

    kind: str
    value: int

    def __str__(self) -> str:
        return f"{self.kind} {self.value}"


@dataclass(slots=True)
class SlaveConfig(Placed):
    """`[[slave]]`: which slave is expected, and what it is told whenever it starts or comes back.

    Attributes:
        position: Its expected position. Where `mark` finds the slave, or it stands behind the
            first slave of its group, which has one, a number above `POSITION_MAX` that stands for
            the slave until the bus is known.
        name: Its name in this machine; other tables and requests may use it. Empty for none.
        type: Its order code, for messages.
        vendor: Expected vendor ID; None: any slave may stand there.
        product: Expected product code; goes with `vendor`.
        revision: The only revision number that is accepted; None for any.
        revision_min: The lowest revision number that is accepted.
        serial: The only serial number that is accepted; None for any.
        alias: Station alias that finds the slave wherever it stands.
        identification: Explicit device identification that finds it, in place of `alias`.
        identification_register: Address in its ESC where its identification is; None: as its
            EEPROM says, or it tells it on request.
        policy: `STRICT` or `TOLERANT`, in place of that of `[expected]`; None for that one.
        optional: Whether it may be absent, and come and go while the bus runs.
        group: Optional slaves with the same group come and go together (hot connect); empty for a
            slave alone.
        watchdog_ms: Time of its process data watchdog in milliseconds, 0 switches it off; None:
            as the slave has it.
        pdi_watchdog_ms: The same for the watchdog between its ESC and its processor (PDI).
        mailbox_timeout_ms: Time in milliseconds that it has to answer over its mailbox; None for
            the usual one.
        mailbox_tries: How often it is asked for an object that it does not answer; None: as usual.
        mailbox_poll_ms: Time in milliseconds between two looks at its mailbox for emergencies, 0
            for no looks; None: `MAILBOX_POLL_MS`.
        module: The modules in its slots; slots without a table are empty. None at all: any modules.
        pdos: Indices of the PDOs that are assigned; None: those that the slave has assigned.
        pdo: PDOs with other entries than those of the slave.
        startup: Start-up parameters in the order in which they are written.
        eoe: Its IP parameters for Ethernet over EtherCAT; None: it keeps those that it has.
    """

    position: int
    name: str = ""
    type: str = ""
    vendor: int | None = None
    product: int | None = None
    revision: int | None = None
    revision_min: int | None = None
    serial: int | None = None
    alias: int | None = None
    identification: int | None = None
    identification_register: int | None = None
    policy: str | None = None
    optional: bool = False
    group: str = ""
    watchdog_ms: float | None = None
    pdi_watchdog_ms: float | None = None
    mailbox_timeout_ms: float | None = None
    mailbox_tries: int | None = None
    mailbox_poll_ms: float | None = None
    module: list[ModuleConfig] = field(default_factory=list)
    pdos: list[int] | None = None
    pdo: list[PdoConfig] = field(default_factory=list)
    startup: list[StartupConfig] = field(default_factory=list)
    eoe: SlaveEoeConfig | None = None

    @property
    def mark(self) -> Mark | None:
        """What finds the slave wherever it stands; None if that is its position."""
        if self.alias is not None:
            return Mark("station alias", self.alias)
        if self.identification is not None:
            return Mark("identification", self.identification)
        return None

    @property
    def poll_s(self) -> float:
        """Seconds between two looks at its mailbox; 0: nobody looks."""
        poll_ms = MAILBOX_POLL_MS if self.mailbox_poll_ms is None else self.mailbox_poll_ms
        return poll_ms / 1000

    @property
    def is_told(self) -> bool:
        """Whether anything is written to objects of the slave before SAFEOP."""
        return self.pdos is not None or bool(self.module or self.pdo or self.startup)

    @property
    def modules(self) -> list[Module]:
        """The expected modules by slot, slot 1 first, up to the last one; none for any modules."""
        by_slot = {item.slot: Module(item.ident, item.type) for item in self.module}
        return [by_slot.get(slot, Module(0)) for slot in range(1, max(by_slot, default=0) + 1)]

    def group_at(self, position: int) -> str:
        """Name of the group of optional slaves that it has at a position, see `Slave.group`."""
        return (self.group or f"slave {position}") if self.optional else ""

    def parameters(self, transition: str) -> list[StartupConfig]:
        """The start-up parameters of one transition, in order."""
        return [item for item in self.startup if item.transition == transition]


def read_slaves(top: Table, key: Key) -> list[SlaveConfig]:
    """Reads all `[[slave]]` tables."""
    slaves: list[SlaveConfig] = []
    names = top.document.names
    for at, row in enumerate(top.tables(key)):
        if about := _about(row):
            top.document.notes[row.path] = about
        group = row.data.get("group")
        marked = [key for key in _MARKS if key in row]
        follows = not marked and any(
            slave.mark is not None and slave.group == group for slave in slaves if group
        )
        found = bool(marked) or follows
        row.only(_SLAVE)
        if not found and "position" not in row:
            row.fail(
                "position",
                "is missing: write where the slave stands, or the alias or the identification by "
                "which it is found",
            )
        values = row.read(_SLAVE)
        _check_identity(row)
        in_group = bool(values.get("group"))
        if not values.setdefault("optional", in_group) and in_group:
            row.fail("optional", "a slave in a group is optional: leave one of them out")
        stand_in = POSITION_MAX + 1 + at
        if found and values.setdefault("position", stand_in) <= POSITION_MAX:
            how = (
                "it stands behind the first of its group"
                if follows
                else f"{marked[0]} finds the slave"
            )
            row.fail("position", f"{how} wherever that is plugged in: leave this out")
        slave = SlaveConfig(**values, table=row)
        for other in slaves:
            if other.position == slave.position:
                row.fail(
                    "position", f"slave {slave.position} has two tables: put all keys into one"
                )
            if other.mark == slave.mark is not None:
                key = marked[0]
                row.fail(
                    key, f"two slaves cannot be found by the same {slave.mark}: correct one of them"
                )
        if slave.name in names:
            row.fail("name", f"'{slave.name}' is the name of another slave, too: choose one")
        if slave.name:
            names[slave.name] = slave.position
        _check_modules(row, slave)
        check_pdos(row, slave.pdos, slave.pdo)
        slaves.append(slave)
    return slaves


def _about(row: Table) -> str:
    """Which slave a table is about, for messages: its number says only which table it is."""
    position, name = row.data.get("position"), row.data.get("name")
    texts = []
    if type(position) is int and 0 <= position <= POSITION_MAX:
        texts.append(f"slave {position}")
    for mark in _MARKS:
        if type(value := row.data.get(mark)) is int and 0 < value <= 0xFFFF:
            texts.append(f"{mark} {value}")
    if isinstance(name, str) and _NAME.fullmatch(name) and len(name.encode()) <= _NAME_BYTES:
        texts.append(name)
    return ", ".join(texts)


def read_expected(top: Table, key: Key) -> ExpectedConfig:
    """Reads `[expected]`."""
    table = top.table(key)
    return ExpectedConfig(**table.read(_EXPECTED), table=table)


def _check_identity(row: Table) -> None:
    """Refuses parts of an identity without the others that they need."""
    marked = [key for key in _MARKS if key in row]
    for one, other in (("vendor", "product"), ("product", "vendor")):
        if one in row and other not in row:
            row.fail(
                other, f"is missing: {one} alone does not say which device is expected; write both"
            )
    for part in ("revision", "revision_min", "serial", "policy"):
        if part in row and "product" not in row and not (part == "policy" and marked):
            row.fail(part, "needs vendor and product: write which device is expected")
    if len(marked) > 1:
        row.fail("identification", "stands in place of alias: leave one of them out")
    if "identification_register" in row and "identification" not in row:
        row.fail(
            "identification",
            "is missing: write the value that the register shall have, or leave "
            "identification_register out",
        )
    for part in ("optional", "group"):
        if row.data.get(part) and "product" not in row:
            row.fail(part, "needs vendor and product: write which device may come and go")
    if "revision" in row and "revision_min" in row:
        row.fail("revision_min", "stands in place of revision: leave one of them out")


def _position(table: Table, key: Key) -> int:
    """Reads a position; `Config.to_dict` also writes one for a slave that is found otherwise."""
    found = any(key in table for key in _MARKS) or table.data.get("group")
    return table.integer(key, 0, 2 * POSITION_MAX if found else POSITION_MAX)


def _file(table: Table, key: Key) -> str:
    path = table.text(key)
    if path and not path.isprintable():
        table.fail(key, f"{show(path)} is no file: write its path in quotes")
    return path


def _name(table: Table, key: Key) -> str:
    name = table.text(key)
    if (name and not _NAME.fullmatch(name)) or len(name.encode()) > _NAME_BYTES:
        table.fail(
            key,
            f"{show(name)} is no name for a {'group' if key == 'group' else 'slave'}: write a "
            f"letter, then letters, digits, '_' and '-', at most {_NAME_BYTES} bytes",
        )
    return name


def _watchdog(table: Table, key: Key) -> float:
    """Reads the time of a watchdog, which the slave counts in steps of 100 µs."""
    time = table.number(key, low=0, high=WATCHDOG_MAX_MS)
    if 0 < time < WATCHDOG_MIN_MS:
        table.fail(key, f"is {time:g}, but must be 0, or at least {WATCHDOG_MIN_MS:g}")
    return time


def _poll(table: Table, key: Key) -> float:
    """Reads the time between two looks at a mailbox; 0: nobody looks."""
    time = table.number(key, low=0, high=_POLL_MAX_MS)
    if 0 < time < _POLL_MIN_MS:
        table.fail(key, f"is {time:g}, but must be 0, or from {_POLL_MIN_MS} to {_POLL_MAX_MS}")
    return time


def _check_modules(row: Table, slave: SlaveConfig) -> None:
    """Refuses two modules in one slot."""
    seen: set[int] = set()
    for table, module in zip(row.tables("module"), slave.module, strict=True):
        if module.slot in seen:
            table.fail("slot", f"slot {module.slot} has two tables: remove one")
        seen.add(module.slot)


_UNSIGNED32 = integer(0, 0xFFFFFFFF)
_MODULE: Rules = {
    "slot": integer(1, _SLOTS_MAX),
    "ident": integer(1, 0xFFFFFFFF),
    "type": printable(NAME_BYTES),
}
_POLICY = choice({policy: policy for policy in (STRICT, TOLERANT)})
_EXPECTED: Rules = {"policy": _POLICY, "unlisted": Table.boolean, "description": _file}
_SLAVE: Rules = {
    "position": _position,
    "name": _name,
    "type": printable(NAME_BYTES),
    "vendor": _UNSIGNED32,
    "product": _UNSIGNED32,
    "revision": _UNSIGNED32,
    "revision_min": _UNSIGNED32,
    "serial": _UNSIGNED32,
    "alias": integer(1, 0xFFFF),
    "identification": integer(1, 0xFFFF),
    "identification_register": integer(
        IDENTIFICATION_REGISTERS.start, IDENTIFICATION_REGISTERS.stop - 1
    ),
    "policy": _POLICY,
    "optional": Table.boolean,
    "group": _name,
    "watchdog_ms": _watchdog,
    "pdi_watchdog_ms": _watchdog,
    "mailbox_timeout_ms": number(10, 9000),
    "mailbox_tries": integer(1, 10),
    "mailbox_poll_ms": _poll,
    "module": lambda row, key: [
        ModuleConfig(**table.read(_MODULE, required=["slot", "ident"]), table=table)
        for table in row.tables(key)
    ],
    "pdos": array(read_pdo_index),
    "pdo": read_pdos,
    "startup": array(read_parameter),
    "eoe": read_slave_eoe,
}
