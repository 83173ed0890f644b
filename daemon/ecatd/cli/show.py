"""Commands that show the slaves: `slaves`, `pdos`, `state`."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from ecatd.base.dataclass_maps import to_maps
from ecatd.base.errors import StateError, UsageError
from ecatd.description.bus import Bus, Slave, display_name, positions_text
from ecatd.description.witnesses import contradiction_text, witness_name
from ecatd.etg.al import AL_ERROR_FLAG, AlState, al_state_text
from ecatd.etg.datatypes import type_name
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.pdo_layout import places
from ecatd.etg.scaling import formula_text, to_physical
from ecatd.operations.bus import ReadStates, SetState, SlaveAlState

from .arguments import add_slave, add_yes, confirm
from .bus_warnings import check_slaves, warn_outdated
from .output import date_text, first_of, print_json, print_table

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

COMMANDS = {
    "bus": {
        "slaves": "List the slaves in the order of the wire.",
        "pdos": "List the process data of the slaves.",
        "state": "Show the AL states of the slaves, or change them.",
    },
}

_DESCRIBED = (
    *("position", "identification", "name", "given_name", "vendor", "product", "address", "coe"),
    *("problems", "domain", "output_bytes", "input_bytes", "dc_bits", "dc_delay_ns", "sync0_ns"),
    *("sync1_ns", "sync_shift_ns", "watchdog_ms"),
)
_CURRENT = ("alias", "recovery", "recovery_text", "revision", "serial", "read_at")
"""Keys of `slaves --json`: of the bus description, and of the AL states."""
_SLAVE_HEAD = (
    *("POS", "ALIAS", "IDENT", "STATE", "NAME", "VENDOR", "PRODUCT", "REVISION"),
    *("DOMAIN", "OUT", "IN"),
)
_PROBLEMS_SHOWN = 10
_START_S = 60.0
"""Seconds after the first EEPROM in which those of a start have been read."""
_NAMED_MAX = 4
"""Most slaves that a question names."""


def add_arguments(command: argparse.ArgumentParser, name: str) -> None:
    """Adds the arguments of a command."""
    if name in ("pdos", "state"):
        add_slave(command)
    if name == "state":
        command.add_argument(
            "state",
            nargs="?",
            metavar="STATE",
            help="bring the slave to this state: INIT, PREOP, BOOT, SAFEOP or OP (without SLAVE: "
            "all slaves)",
        )
        add_yes(command)


def slaves(remote: Remote, options: argparse.Namespace) -> int:
    """Lists the slaves in the order of the wire."""
    bus = remote.describe()
    health = remote.health()
    states = {row["position"]: row for row in health.rows}
    if options.json:
        rows = [_slave_document(bus, slave, states[slave.position]) for slave in bus.slaves]
        known = {"bus": bus.name, "fingerprint": f"{bus.fingerprint:016x}"}
        print_json({**known, "slaves": rows, "differences": health.differences})
    else:
        _print_slaves(bus, states)
        _print_differences(health.differences)
    return check_slaves(health)


def _slave_document(bus: Bus, slave: Slave, state: Mapping[str, Any]) -> dict[str, Any]:
    """What is known of a slave: as the description says, and as it is now."""
    return {
        **{key: getattr(slave, key) for key in _DESCRIBED},
        **{key: state[key] for key in _CURRENT},
        "state": al_state_text(state["al_state"]),
        "modules": [asdict(module) for module in slave.modules],
        "contradictions": to_maps(slave.contradictions),
        "domain_name": bus.domain_name(slave.domain),
    }


def _print_slaves(bus: Bus, states: dict[int, SlaveAlState]) -> None:
    print_table(
        _SLAVE_HEAD,
        (
            (
                slave.position,
                "-" if states[slave.position]["alias"] is None else states[slave.position]["alias"],
                slave.identification,
                _state(states[slave.position]),
                slave.display_name,
                f"0x{slave.vendor:08X}",
                f"0x{slave.product:08X}",
                f"0x{states[slave.position]['revision']:08X}",
                f"{slave.domain} {bus.domain_name(slave.domain)}".rstrip(),
                f"{slave.output_bytes} B",
                f"{slave.input_bytes} B",
            )
            for slave in bus.slaves
        ),
        ">>>      >>",
    )
    for slave in bus.slaves:
        if slave.modules:
            print(f"{slave.label}: {_modules(slave)}")
        for item in slave.contradictions:
            chosen = f"; {witness_name(item.believed)} is believed" if item.believed else ""
            print(f"{slave.label}: {contradiction_text(item)}{chosen}")
        for problem in first_of(slave.problems, _PROBLEMS_SHOWN, " (--json lists all)"):
            print(f"{slave.label}: EEPROM, {problem}")
    print(_of_when([row["read_at"] for row in states.values()]))


def _of_when(moments: list[float | None]) -> str:
    """Says of when the columns are."""
    first = min((moment for moment in moments if moment), default=0.0)
    later = [n for n, moment in enumerate(moments) if moment and moment - first > _START_S]
    text = f"STATE and ALIAS are current; ecatd read the rest at {date_text(first)}"
    return f"{text} (of slaves {positions_text(later)}: later)" if later else text


def _print_differences(differences: list[str]) -> None:
    """Prints what was missing at the start, and which other devices are there."""
    for text in differences:
        print(f"not as configured: {text}")


def _modules(slave: Slave) -> str:
    """What is in the slots of a slave: `modules in slots 1 DI8 (0x00000108), 4 0x00000302`."""
    plugged = [(slot, module) for slot, module in enumerate(slave.modules, 1) if module.ident]
    if not plugged:
        return f"no modules in its {len(slave.modules)} slots"
    return f"modules in slots {', '.join(f'{slot} {module.label}' for slot, module in plugged)}"


def _state(row: SlaveAlState) -> str:
    """AL state of a slave; if it should be in OP and is not, also the state of its recovery."""
    text = al_state_text(row["al_state"])
    return f"{text}, {row['recovery']}" if row.get("recovery") else text


def pdos(remote: Remote, options: argparse.Namespace) -> None:
    """Lists the process data of one slave or all."""
    bus, rows = remote.describe(), remote.request(ReadStates())["slaves"]
    chosen = bus.slaves if options.slave is None else [bus.find(options.slave)]
    old = warn_outdated(bus, [rows[slave.position] for slave in chosen])
    if options.json:
        document = bus.to_dict()
        positions = {slave.position for slave in chosen}
        document["slaves"] = [s for s in document["slaves"] if s["position"] in positions]
        document = {"domains": document["domains"], "slaves": document["slaves"]}
        print_json({"bus": bus.name, **document, "outdated": old})
        return
    for slave in chosen:
        domain = f"  ({bus.domain_label(slave.domain)})" if len(bus.domains) > 1 else ""
        print(f"{slave.position}  {slave.display_name}{domain}")
        if not slave.outputs and not slave.inputs:
            print("  no process data")
        for title, kind, group in (
            ("outputs", "RxPDO", slave.outputs),
            ("inputs", "TxPDO", slave.inputs),
        ):
            if group:
                print(f"  {title}")
            _print_pdos(kind, group)


def _print_pdos(kind: str, group: list[Pdo]) -> None:
    bits = {id(entry): bit for _, entry, bit in places(group)}
    for pdo in group:
        said = f", as {witness_name(pdo.witness)} says" if pdo.witness else ""
        name = f"    {kind} 0x{pdo.index:04X}  {pdo.name}".rstrip()
        print(f"{name}  (SM{pdo.sync_manager}{said})")
        for entry in pdo.entries:
            byte, bit = divmod(bits[id(entry)], 8)
            place = f"{byte:4d}.{bit}"
            if entry.is_gap:
                print(f"      {place}  -          {entry.bit_length:2d} bit  (gap)")
                continue
            print(
                f"      {place}  {entry.address}  {entry.bit_length:2d} bit  "
                f"{type_name(entry.data_type):<10}  {entry.name}  {_meaning(entry)}".rstrip()
            )


def _conversion(entry: Entry) -> str:
    """The formula for the physical value: `V = raw * 0.000305185`."""
    return f"{entry.unit or 'value'} = {formula_text('raw', entry.scale, entry.offset)}"


def _meaning(entry: Entry) -> str:
    """Describes conversion, limits and safe value of an entry, in brackets."""
    facts = [_conversion(entry)] if entry.is_physical else []
    if (entry.minimum, entry.maximum) != (None, None):
        low = "any" if entry.minimum is None else f"{entry.minimum:g}"
        high = "any" if entry.maximum is None else f"{entry.maximum:g}"
        facts.append(f"{low} to {high}")
    if entry.safe is not None:
        safe = entry.safe
        if entry.is_physical and not isinstance(safe, str):
            safe = f"{to_physical(safe, entry.scale, entry.offset):g}"
        facts.append(f"safe {safe}")
    return f"[{', '.join(facts)}]" if facts else ""


def state(remote: Remote, options: argparse.Namespace) -> int:
    """Shows the AL states, or brings slaves to one."""
    if options.state is None and isinstance(options.slave, str):
        with suppress(UsageError):  # a slave that is named like a state needs its position here
            options.state = AlState.parse(options.slave).name
            options.slave = None
    try:
        chosen = None if options.slave is None else remote.describe().find(options.slave).position
    except StateError as error:
        if options.state is not None or not isinstance(options.slave, str):
            raise
        raise UsageError(f"{error}; AL states are INIT, PREOP, BOOT, SAFEOP and OP") from error
    if options.state is not None:
        _ask(remote, options, chosen)
        remote.request(SetState(options.state, chosen))["slaves"]
    health = remote.health()
    rows = health.rows
    shown = rows if chosen is None else [row for row in rows if row["position"] == chosen]
    differences = health.differences if chosen is None else []
    if options.json:
        print_json({"bus": remote.bus, "slaves": shown, "differences": differences})
    else:
        print_table(
            ("POS", "NAME", "STATE"),
            (
                (
                    row["position"],
                    display_name(row.get("given_name", ""), row["name"]),
                    _state_text(row),
                )
                for row in shown
            ),
            ">",
        )
        _print_differences(differences)
    return check_slaves(health)


def _ask(remote: Remote, options: argparse.Namespace, chosen: int | None) -> None:
    """Asks before slaves leave OP; the way up needs no question.

    Raises:
        UsageError: There is no such state, or the user does not want it.
    """
    wanted = AlState.parse(options.state)
    if options.yes or wanted == AlState.OP:
        return
    bus = remote.describe()
    leaving = [
        bus.slaves[row["position"]].label
        for row in remote.request(ReadStates())["slaves"]
        if row["al_state"] & ~AL_ERROR_FLAG == AlState.OP and chosen in (None, row["position"])
    ]
    if leaving:
        few = len(leaving) <= _NAMED_MAX
        who = ", ".join(leaving) if few else f"{len(leaving)} slaves of bus '{bus.name}'"
        whose = "its" if len(leaving) == 1 else "their"
        confirm(
            options, f"This takes {who} out of OP, to {wanted.name}: {whose} outputs become safe."
        )


def _state_text(row: SlaveAlState) -> str:
    """AL state of a slave, and what is known about its recovery."""
    known = (row["text"], row.get("recovery"), row.get("recovery_text"))
    return "; ".join(text for text in known if text)
