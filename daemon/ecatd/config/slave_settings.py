"""Which slaves are expected: the keys of `[[slave]]` and `[expected]`, and how they are read."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

from ecatd.base.toml_file import (
    Key,
    Table,
    accepts,
    array,
    integer,
    number,
    one_of,
    printable,
    show,
    zero_or,
)
from ecatd.description.bus import Module
from ecatd.description.limits import (
    POSITION_MAX,
    SIGNAL_NAME_BYTES,
    SLAVE_NAME_BYTES,
    is_slave_name,
)
from ecatd.description.witnesses import COE, CONFIGURATION, SII, SOE
from ecatd.etg.can_terminals import SETTLED_PDOS

from .can import SlaveCanConfig, read_slave_can
from .eoe import SlaveEoeConfig, read_slave_eoe
from .idns import IdnConfig, read_idn_parameter
from .pdos import PdoConfig, check_pdos, read_assigned
from .placed import Placed, each, rules_of
from .startup import TRANSITIONS_DOWN, StartupConfig, read_parameter

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
_MARKS = ("alias", "identification")


@accepts(f"0 to {POSITION_MAX}")
def _position(table: Table, key: Key) -> int:
    """Reads a position; `Config.to_dict` also writes one for a slave that is found otherwise."""
    found = any(key in table for key in _MARKS) or table.data.get("group")
    return table.integer(key, 0, 2 * POSITION_MAX if found else POSITION_MAX)


@accepts("the path of a file")
def _file(table: Table, key: Key) -> str:
    path = table.text(key)
    if path and not path.isprintable():
        table.fail(key, f"{show(path)} is not a file: write its path in quotes")
    return path


@accepts(f"a letter, then letters, digits, `_`, `-`; at most {SLAVE_NAME_BYTES} bytes")
def _name(table: Table, key: Key) -> str:
    name = table.text(key)
    if name and not is_slave_name(name):
        table.fail(
            key,
            f"{show(name)} cannot be the name of a {'group' if key == 'group' else 'slave'}: "
            f"write a letter, then letters, digits, '_' and '-', at most {SLAVE_NAME_BYTES} bytes",
        )
    return name


_WATCHDOG = zero_or(WATCHDOG_MIN_MS, WATCHDOG_MAX_MS)  # slaves count it in steps of 100 µs
_UNSIGNED32 = integer(0, 0xFFFFFFFF)
_POLICY = one_of((STRICT, TOLERANT))
_REGISTER = integer(IDENTIFICATION_REGISTERS[0], IDENTIFICATION_REGISTERS[-1])


@dataclass(slots=True)
class ModuleConfig(Placed):
    """`[[slave.module]]`: one table for each [module](configuration.md#modules) in a slot.

    This is for modular devices (ETG.5001). Slots without a table are empty. Without such tables,
    ecatd accepts any modules.

    Attributes:
        slot: Number of the slot.
        ident: Module ident, such as `0x00000108`.
        type: Its type, for messages.
    """

    slot: Annotated[int, integer(1, _SLOTS_MAX)]
    ident: Annotated[int, integer(1, 0xFFFFFFFF)]
    type: Annotated[str, printable(SIGNAL_NAME_BYTES)] = ""


@dataclass(slots=True)
class ExpectedConfig(Placed):
    """`[expected]`: what happens if the bus is not [expected](configuration.md#the-expected-bus).

    Attributes:
        policy: What happens if the bus is not the one that the `[[slave]]` tables describe:
            `"strict"`: it does not start; `"tolerant"`: it starts without the slaves that are not
            as expected.
        unlisted: Use slaves behind the last one with an identity in a `[[slave]]`; `false`: each of
            them is a difference.
        description: File with the description of the complete bus, as `ecatctl scan -o` writes it;
            for [optional slaves](configuration.md#optional-slaves). A relative path starts at the
            folder of this file. `""`: none.
    """

    policy: Annotated[str, _POLICY] = STRICT
    unlisted: Annotated[bool, Table.boolean] = True
    description: Annotated[str, _file] = ""


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
    """`[[slave]]`: which slave is expected, and what it is told when it starts or comes back.

    One table for each slave that you [expect](configuration.md#the-expected-bus), that you name, or
    that needs [settings](configuration.md#what-ecatd-writes-to-slaves).

    Attributes:
        position: Position of the slave. Default: needed, unless the table has `alias` or
            `identification`, or follows such a table in the same group.
        name: Name of the slave in your machine, which other tables, `ecatctl` and programs can use;
            two slaves cannot have the same name. `""`: none.
        type: Its order code, such as `"EL2008"`, for messages about a slave that is missing.
        vendor: Vendor ID of the expected slave; goes with `product`. Default: any.
        product: Product code of the expected slave; goes with `vendor`. Default: any.
        revision: The only revision number that is accepted. Default: any.
        revision_min: The lowest revision number that is accepted, in place of `revision`. Default:
            any.
        serial: The only serial number that is accepted. Default: any.
        alias: Station alias, which finds the slave wherever it stands. Default: none.
        identification: [Device identification](configuration.md#the-expected-bus), as of a rotary
            switch, which finds the slave wherever it stands; in place of `alias`. Default: none.
        identification_register: Address in the ESC from which ecatd reads the identification, for a
            slave that does not answer the request. Default: as its EEPROM says.
        policy: What happens if there is a difference at this slave. Default: that of `[expected]`.
        optional: The slave may be absent, and [come and go](configuration.md#optional-slaves) while
            the bus runs; a slave in a group always may.
        group: Optional slaves with the same group come and go together (hot connect); `""`: a slave
            alone.
        watchdog_ms: Time of its process data [watchdog](configuration.md#watchdogs); 0: off.
            Default: that of the slave, usually 100.
        pdi_watchdog_ms: Time of the watchdog between its ESC and its processor (PDI); 0: off.
            Default: that of the slave, usually 100.
        mailbox_timeout_ms: Time that the slave has to answer over its mailbox (SDO). Set it for a
            slave that needs more. A whole request, such as one for a long object, has 30 times as
            long, and 30 s at least. Default: `1000`.
        mailbox_tries: Number of times that ecatd asks the slave for an object before it counts as a
            slave that does not answer. From the second time on the slave has 2 s, or
            `mailbox_timeout_ms` if that is longer. ecatd writes an object only once, since writing
            may have an effect. Default: `3`.
        mailbox_poll_ms: Time between two looks into the mailbox of the slave, in which ecatd finds
            its [emergencies](troubleshooting.md#ecatd-does-not-start). Use a longer time, or 0
            (never), for a slave that must not be disturbed: its emergencies then come with the
            answer to the next request. With [EoE](ethernet.md), it cannot be 0. Default:
            `MAILBOX_POLL_MS`.
        module: The modules in its slots; none: any modules.
        pdos: Indices of the PDOs that the slave shall exchange, such as `["0x1605", "0x1A02"]`.
            Default: those that the slave has assigned.
        pdo: PDOs with other entries than those of the slave.
        pdo_source: Which [witness](configuration.md#which-witness-is-believed) is believed of what
            is in the PDOs: `"coe"`: the objects of the slave; `"soe"`: the telegrams of a drive
            with SoE; `"sii"`: its EEPROM; `"configuration"`: the `[[slave.pdo]]` tables, which are
            then not written to the slave.
            Default: the slave itself, if no other witness contradicts it.
        startup: Start-up parameters in the order in which they are written.
        idn: IDNs for drives with SoE, in the order in which they are written; behind `startup`.
        eoe: Its IP parameters. None: it keeps those that it has.
        can: The CAN bus behind it. None: its process data are like those of others.
    """

    # If something else finds the slave: above `POSITION_MAX`, until the bus is known.
    position: Annotated[int, _position]
    name: Annotated[str, _name] = ""
    type: Annotated[str, printable(SIGNAL_NAME_BYTES)] = ""
    vendor: Annotated[int | None, _UNSIGNED32] = None
    product: Annotated[int | None, _UNSIGNED32] = None
    revision: Annotated[int | None, _UNSIGNED32] = None
    revision_min: Annotated[int | None, _UNSIGNED32] = None
    serial: Annotated[int | None, _UNSIGNED32] = None
    alias: Annotated[int | None, integer(1, 0xFFFF)] = None
    identification: Annotated[int | None, integer(1, 0xFFFF)] = None
    identification_register: Annotated[int | None, _REGISTER] = None
    policy: Annotated[str | None, _POLICY] = None
    optional: Annotated[bool, Table.boolean] = False
    group: Annotated[str, _name] = ""
    watchdog_ms: Annotated[float | None, _WATCHDOG] = None
    pdi_watchdog_ms: Annotated[float | None, _WATCHDOG] = None
    mailbox_timeout_ms: Annotated[float | None, number(10, 9000)] = None
    mailbox_tries: Annotated[int | None, integer(1, 10)] = None
    mailbox_poll_ms: Annotated[float | None, zero_or(_POLL_MIN_MS, _POLL_MAX_MS)] = None
    module: Annotated[list[ModuleConfig], each(ModuleConfig)] = field(default_factory=list)
    pdos: Annotated[list[int] | None, read_assigned] = None
    pdo: Annotated[list[PdoConfig], each(PdoConfig)] = field(default_factory=list)
    pdo_source: Annotated[str | None, one_of((COE, SOE, SII, CONFIGURATION))] = None
    startup: Annotated[list[StartupConfig], array(read_parameter)] = field(default_factory=list)
    idn: Annotated[list[IdnConfig], array(read_idn_parameter)] = field(default_factory=list)
    eoe: Annotated[SlaveEoeConfig | None, read_slave_eoe] = None
    can: Annotated[SlaveCanConfig | None, read_slave_can] = None

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
    def writes_objects(self) -> bool:
        """Whether anything is written to objects or IDNs of the slave before SAFEOP."""
        tables = self.module or self.mapped or self.startup or self.idn or self.can
        return self.pdos is not None or bool(tables)

    @property
    def mapped(self) -> list[PdoConfig]:
        """The PDOs into which the slave shall map other entries."""
        return [] if self.pdo_source == CONFIGURATION else self.pdo

    @property
    def described(self) -> dict[int, PdoConfig]:
        """The PDOs whose entries the configuration describes as they are, by index."""
        return {pdo.index: pdo for pdo in self.pdo} if self.pdo_source == CONFIGURATION else {}

    @property
    def remapped(self) -> set[int]:
        """Indices of the PDOs that get other entries when the slave starts."""
        indices = {pdo.index for pdo in self.mapped} | {item.address[0] for item in self.startup}
        if self.can is not None:
            indices |= SETTLED_PDOS
        return indices | {item.telegram for item in self.idn if item.telegram is not None}

    @property
    def modules(self) -> list[Module]:
        """The expected modules by slot, slot 1 first, up to the last one; none for any modules."""
        by_slot = {item.slot: Module(item.ident, item.type) for item in self.module}
        return [by_slot.get(slot, Module(0)) for slot in range(1, max(by_slot, default=0) + 1)]

    def group_at(self, position: int) -> str:
        """Name of the group of optional slaves that it has at a position, see `Slave.group`."""
        return (self.group or f"slave {position}") if self.optional else ""

    def startup_value(self, address: tuple[int, int]) -> StartupConfig | None:
        """The start-up parameter that writes an object last on the way to OP."""
        found = [
            item
            for item in self.startup
            if item.address == address
            and not item.complete
            and item.transition not in TRANSITIONS_DOWN
        ]
        return found[-1] if found else None

    def parameters(self, transition: str) -> list[StartupConfig]:
        """The start-up parameters of one transition, in order."""
        return [item for item in self.startup if item.transition == transition]

    def idns(self, transition: str) -> list[IdnConfig]:
        """The IDNs that are written in one transition, in order."""
        return [item for item in self.idn if item.transition == transition]

    def has_parameters(self, transition: str) -> bool:
        """Whether anything is written in one transition."""
        return bool(self.parameters(transition) or self.idns(transition))


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
        rules = rules_of(SlaveConfig)
        row.only(rules)
        if not found and "position" not in row:
            row.fail(
                "position",
                "is missing: write the position of the slave, or the `alias` or the "
                "`identification` by which ecatd finds it",
            )
        values = row.read(rules)
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
        if slave.pdo_source == CONFIGURATION and not slave.pdo:
            row.fail(
                "pdo_source",
                "the configuration describes no PDO: write its entries in [[slave.pdo]]",
            )
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
    if isinstance(name, str) and is_slave_name(name):
        texts.append(name)
    return ", ".join(texts)


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


def _check_modules(row: Table, slave: SlaveConfig) -> None:
    """Refuses two modules in one slot."""
    seen: set[int] = set()
    for table, module in zip(row.tables("module"), slave.module, strict=True):
        if module.slot in seen:
            table.fail("slot", f"slot {module.slot} has two tables: remove one")
        seen.add(module.slot)
