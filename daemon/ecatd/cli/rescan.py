"""Commands `rescan` and `reboot`: what is on the wire now; and a reset of a slave controller."""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING, Any

from ecatd.base.errors import EcatError, NoAnswerError, StateError
from ecatd.base.timeouts import Timeout
from ecatd.description.bus import Bus, Slave
from ecatd.etg.al import AlState
from ecatd.operations.bus import Device, ReadStates, Rescan
from ecatd.operations.registers import WriteRegister

from .arguments import add_one_slave, add_yes, confirm
from .output import print_json, print_table, progress

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

COMMANDS = {
    "slaves": {
        "rescan": "Compare the devices on the wire with those found at the start.",
        "reboot": "Reset the controller of a slave, and wait until it is back.",
    },
}

_RESET, _LETTERS = 0x0040, b"RES"
"""Register "ESC reset ECAT" (ETG.1000.4): three letters in three writes."""
_PAUSE = 0.1
_DIFFERENT = 7
"""Exit status if the wire differs from the start; the same as for an unexpected bus."""


def add_arguments(command: argparse.ArgumentParser, name: str) -> None:
    """Adds the arguments of a command."""
    if name == "reboot":
        add_one_slave(command)
        add_yes(command)


# --- rescan --------------------------------------------------------------------------------------


def rescan(remote: Remote, options: argparse.Namespace) -> int:
    """Reads which devices are on the wire, and compares them with the slaves of the bus."""
    bus = remote.describe()
    with progress() as show:
        show("the daemon looks at the devices on the wire")
        answer = remote.request(Rescan())
    missing = [bus.slaves[at] for at in answer["missing"]]
    rows = [_row(bus, missing, place, device) for place, device in enumerate(answer["devices"])]
    _mark_twice(bus, rows)
    different = [row for row in rows if row["difference"]]
    lost = [item for item in missing if not item.group]
    if options.json:
        absent = [item.position for item in missing]
        print_json({"bus": bus.name, "devices": rows, "missing": absent})
    else:
        print_table(
            ("PLACE", "SLAVE", "VENDOR", "PRODUCT", "REVISION", "SERIAL", "WHAT"),
            (_cells(bus, row) for row in rows),
        )
        for item in missing:
            print(f"{item.label} is not there{' (optional)' if item.group else ''}")
        print(_conclusion(len(rows), bool(different), lost))
    return _DIFFERENT if different or lost else 0


def _row(bus: Bus, missing: list[Slave], place: int, device: Device) -> dict[str, Any]:
    position = device["position"]
    row = {"place": place, **device, "difference": ""}
    identity = device["vendor"], device["product"], device["revision"]
    if position is None:
        name = f" ({device['name']})" if device["name"] else ""
        row["difference"] = f"new{name}: not a slave of this bus"
        for item in missing:
            if identity == (item.vendor, item.product, item.revision):
                row["difference"] = (
                    f"perhaps {item.label}, which was switched off and on: `ecatctl state "
                    f"{item.position} OP` brings it back, if ecatd does not"
                )
    elif device["vendor"] is None:
        row["difference"] = "its EEPROM cannot be read"
    else:
        known = bus.slaves[position]
        if (device["vendor"], device["product"]) != (known.vendor, known.product):
            row["difference"] = f"another device than {known.label}"
        elif device["revision"] != known.revision:
            row["difference"] = f"another revision than 0x{known.revision:08X}"
    return row


def _mark_twice(bus: Bus, rows: list[dict[str, Any]]) -> None:
    """Says of devices at the address of the same slave that they differ from the start."""
    places: dict[int, list[dict[str, Any]]] = {}
    for row in rows:
        if row["position"] is not None:
            places.setdefault(row["position"], []).append(row)
    for position, alike in places.items():
        for row in alike if len(alike) > 1 else ():
            where = ", ".join(str(other["place"]) for other in alike if other is not row)
            row["difference"] = (
                f"has the address of {bus.slaves[position].label}, like place {where}, so both get "
                "its outputs: remove one of them, or switch one off and on"
            )


def _cells(bus: Bus, row: dict[str, Any]) -> tuple[object, ...]:
    position = row["position"]
    name = "" if position is None else f"{position} {bus.slaves[position].display_name}"
    numbers = [row[key] for key in ("vendor", "product", "revision", "serial")]
    texts = ("" if number is None else f"0x{number:08X}" for number in numbers)
    return row["place"], name, *texts, row["difference"]


def _conclusion(count: int, different: bool, lost: list[Slave]) -> str:
    if lost:
        return (
            f"{count} devices. ecatd brings missing slaves back when they answer, unless somebody "
            "has taken them out of OP"
        )
    if different:
        return (
            f"{count} devices, and some differ from the start: a restart of the daemon uses the "
            "bus as it is now, if the configuration expects it (`ecatctl config check FILE`)"
        )
    return f"{count} devices, all as at the start"


# --- reboot --------------------------------------------------------------------------------------


def reboot(remote: Remote, options: argparse.Namespace) -> None:
    """Resets a slave controller, and waits until ecatd has brought the slave back.

    Raises:
        StateError: The slave controller does not reset itself.
        NoAnswerError: The slave does not come back in time.
    """
    found = remote.describe().find(options.slave)
    confirm(
        options,
        f"This resets the controller of {found.label}, and its processor if that is wired: its "
        "outputs go off until ecatd has set it up again.",
    )
    begin = time.monotonic()
    _reset(remote, found)
    _wait(remote, found, begin, Timeout(options.timeout, "--timeout"))
    took = time.monotonic() - begin
    if options.json:
        print_json({"bus": remote.bus, "slave": found.position, "seconds": round(took, 3)})
    else:
        print(f"{found.label} was reset, and is in OP again after {took:.1f} s")


def _reset(remote: Remote, found: Slave) -> None:
    for letter in _LETTERS:
        try:
            step = remote.request(WriteRegister(found.position, _RESET, bytes([letter])))["data"]
        except NoAnswerError:
            if letter == _LETTERS[-1]:
                return  # it has lost its address, which shows that it was reset
            raise
    states = {row["position"]: row for row in remote.request(ReadStates())["slaves"]}
    if states[found.position]["al_state"] == AlState.OP:
        raise StateError(
            f"{found.label} is still in OP: its controller does not reset itself by register "
            f"0x{_RESET:04X} (which has {step.hex()}); switch it off and on"
        )


def _wait(remote: Remote, found: Slave, begin: float, patience: Timeout) -> None:
    with progress() as show:
        while True:
            try:
                state = remote.request(ReadStates())["slaves"][found.position]
                if state["al_state"] == AlState.OP:
                    return
                text = ", ".join(filter(None, (state["text"], state["recovery_text"])))
            except EcatError as error:
                text = str(error)
            if time.monotonic() > begin + patience.seconds:
                raise NoAnswerError(
                    f"{found.label} was reset, and has not come back to OP within {patience}: "
                    f"{text}"
                )
            show(text)
            time.sleep(_PAUSE)
