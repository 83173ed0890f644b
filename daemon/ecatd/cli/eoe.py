"""Commands `eoe`, `eoe-read` and `eoe-write`: Ethernet over EtherCAT (EoE)."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from ecatd.base.errors import UsageError
from ecatd.etg.eoe import NONE, parse_address, parse_interface, parse_mac, parse_name
from ecatd.operations.ethernet import ReadEthernet, ReadIp, WriteIp

from .arguments import add_one_slave
from .output import print_json, print_table

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

COMMANDS = {
    "mailboxes": {
        "eoe": "Show the interface to slaves with Ethernet (EoE), and count their frames.",
        "eoe-read": "Read the IP parameters of a slave (EoE).",
        "eoe-write": "Write IP parameters of a slave (EoE).",
    },
}

_MACS_SHOWN = 4
"""Most addresses at one slave in the table: a device can invent any number of them."""
_WHAT = {
    "address": "IP address",
    "mask": "network mask",
    "gateway": "default gateway",
    "dns": "DNS server",
    "name": "DNS name",
    "mac": "MAC address",
}


def add_arguments(command: argparse.ArgumentParser, name: str) -> None:
    """Adds the arguments of a command."""
    if name == "eoe":
        return
    add_one_slave(command)
    if name == "eoe-write":
        for option, metavar, parse, text in (
            ("address", "ADDRESS/SIZE", parse_interface, "IP address and size of the network"),
            ("gateway", "ADDRESS", parse_address, "default gateway"),
            ("dns", "ADDRESS", parse_address, "DNS server"),
            ("name", "NAME", parse_name, "DNS name"),
            ("mac", "MAC", parse_mac, "MAC address"),
        ):
            command.add_argument(
                f"--{option}",
                metavar=metavar,
                type=_checked(option, parse),
                help=text + _AS[option],
            )


_AS = {
    "address": ", as 192.168.7.2/24",
    "gateway": ", as 192.168.7.1, or none",
    "dns": ", or none",
    "name": ", or none",
    "mac": ", as 02:00:00:00:00:01",
}


def _checked(option: str, parse: Callable[[str], object]) -> Callable[[str], str]:
    def check(text: str) -> str:
        if text == NONE and "none" in _AS[option]:
            return text
        try:
            parse(text)
        except UsageError as error:
            raise argparse.ArgumentTypeError(str(error)) from error
        return text

    return check


def eoe(remote: Remote, options: argparse.Namespace) -> None:
    """Shows the interface, and the slaves with EoE."""
    found = remote.request(ReadEthernet())
    if options.json:
        print_json({"bus": remote.bus, **found})
        return
    if not found["slaves"]:
        print("no slave has EoE")
        return
    if not found["interface"]:
        print(
            "there is no interface to the slaves: write its name into the configuration, "
            "[eoe] interface, and restart ecatd"
        )
        print_table(("SLAVE", "NAME"), ((row["slave"], row["name"]) for row in found["slaves"]))
        return
    print(
        found["problem"]
        or f"interface {found['interface']} {found['address']}".rstrip()
        + f": {found['received']} frames to slaves, {found['sent']} from them, "
        f"{found['dropped']} dropped"
    )
    print_table(
        ("SLAVE", "NAME", "TO SLAVE", "FROM SLAVE", "DROPPED", "INCOMPLETE", "MAC ADDRESSES"),
        (
            (
                *(row[key] for key in ("slave", "name", "sent", "received", "dropped", "lost")),
                _first(row["macs"]),
            )
            for row in found["slaves"]
        ),
    )


def _first(macs: list[str]) -> str:
    """The first addresses; `--json` has all."""
    more = len(macs) - _MACS_SHOWN
    return " ".join(macs[:_MACS_SHOWN]) + (f" and {more} more" if more > 0 else "")


def eoe_read(remote: Remote, options: argparse.Namespace) -> None:
    """Reads the IP parameters of a slave."""
    found = _parameters(remote.request(ReadIp(options.slave)))
    if options.json:
        print_json({"bus": remote.bus, "slave": options.slave, "ip": found})
        return
    _print(found)


def eoe_write(remote: Remote, options: argparse.Namespace) -> None:
    """Writes IP parameters of a slave."""
    wanted = {key: getattr(options, key) for key in ("mac", "address", "gateway", "dns", "name")}
    if not any(wanted.values()):
        raise UsageError("nothing is to be written: give --address 192.168.7.2/24, or another one")
    found = remote.request(WriteIp(options.slave, **wanted))
    ip, before = _parameters(found), _parameters(found["before"])
    if options.json:
        print_json({"bus": remote.bus, "slave": options.slave, "ip": ip, "before": before})
        return
    _print(ip)


def _parameters(found: Mapping[str, Any]) -> dict[str, str | None]:
    return {key: found[key] for key in _WHAT}


def _print(found: Mapping[str, Any]) -> None:
    print_table(
        ("PARAMETER", "VALUE"), ((text, found[key] or "none") for key, text in _WHAT.items())
    )
