"""Registers of an EtherCAT slave controller (ETG.1000.4), by the names that users type."""

from __future__ import annotations

from typing import NamedTuple

from ecatd.base.close_names import did_you_mean
from ecatd.base.errors import UsageError


class Register(NamedTuple):
    """A register, or a row of them.

    Attributes:
        name: The name.
        address: The first address.
        size: Its bytes.
        text: What it is.
    """

    name: str
    address: int
    size: int
    text: str


REGISTERS = (
    Register("type", 0x0000, 1, "type of the ESC"),
    Register("revision", 0x0001, 1, "revision of the ESC"),
    Register("build", 0x0002, 2, "build of the ESC"),
    Register("fmmus", 0x0004, 1, "number of FMMUs"),
    Register("sync_managers", 0x0005, 1, "number of sync managers"),
    Register("ram_size", 0x0006, 1, "process memory in KiB"),
    Register("ports", 0x0007, 1, "kinds of the ports, two bits each: 1 none, 2 EBUS, 3 MII"),
    Register("features", 0x0008, 2, "features: bit 2 distributed clocks, bit 3 64 bits"),
    Register("station_address", 0x0010, 2, "configured station address"),
    Register("station_alias", 0x0012, 2, "configured station alias"),
    Register("dl_control", 0x0100, 4, "forwarding and ports"),
    Register("dl_status", 0x0110, 2, "links and loops of the ports"),
    Register("al_control", 0x0120, 2, "AL state that is asked for"),
    Register("al_status", 0x0130, 2, "AL state, and error bit 4"),
    Register("al_status_code", 0x0134, 2, "why a state was left or refused"),
    Register("run_led", 0x0138, 1, "RUN LED: bit 4 takes it over, bits 0 to 3 how it blinks"),
    Register("pdi_control", 0x0140, 2, "kind of the process data interface"),
    Register("ecat_event_mask", 0x0200, 2, "events that are reported to the master"),
    Register("ecat_event", 0x0210, 2, "events for the master"),
    Register("al_event", 0x0220, 4, "events for the application"),
    Register("rx_errors", 0x0300, 8, "of each port: invalid frames, physical errors"),
    Register("forwarded_errors", 0x0308, 4, "of each port: errors that an earlier slave found"),
    Register("processing_errors", 0x030C, 1, "errors of the processing unit"),
    Register("pdi_errors", 0x030D, 1, "errors of the process data interface"),
    Register("lost_links", 0x0310, 4, "of each port: how often its link was lost"),
    Register("watchdog_divider", 0x0400, 2, "base of the watchdogs: steps of 40 ns, minus 2"),
    Register("watchdog_pdi", 0x0410, 2, "time of the PDI watchdog"),
    Register("watchdog_process_data", 0x0420, 2, "time of the process data watchdog"),
    Register("watchdog_status", 0x0440, 2, "bit 0: the process data watchdog has not expired"),
    Register("watchdog_expired", 0x0442, 2, "how often the watchdogs expired: process data, PDI"),
    Register("eeprom_configuration", 0x0500, 2, "who has access to the EEPROM"),
    Register("eeprom_control", 0x0502, 2, "command and status of the EEPROM"),
    Register("system_time", 0x0910, 8, "time of its clock in ns since 2000"),
    Register("system_time_offset", 0x0920, 8, "offset of its local clock in ns"),
    Register("system_time_delay", 0x0928, 4, "propagation delay in ns"),
    Register("system_time_difference", 0x092C, 4, "difference to the reference clock"),
    Register("sync_activation", 0x0980, 2, "SYNC signals: who controls them, which are on"),
    Register("sync0_start", 0x0990, 8, "time of the next SYNC0 in ns"),
    Register("sync0_cycle_time", 0x09A0, 4, "period of SYNC0 in ns"),
    Register("sync1_cycle_time", 0x09A4, 4, "time from SYNC0 to SYNC1 in ns"),
)
"""In ascending order."""

_CONTROLLED = (
    (0x0010, 0x0012, "the station address"),
    (0x0100, 0x0104, "forwarding"),
    (0x0120, 0x0122, "the AL state"),
    (0x0400, 0x0430, "the watchdogs"),
    (0x0500, 0x0510, "access to the EEPROM"),
    (0x0600, 0x0700, "the FMMUs"),
    (0x0800, 0x0900, "the sync managers"),
    (0x0900, 0x0A00, "the distributed clock"),
)
"""First register, the one after the last, and what the daemon controls with them."""


def find_register(name: str) -> Register:
    """The register with a name.

    Raises:
        UsageError: There is no such register.
    """
    for item in REGISTERS:
        if item.name == name.lower().replace("-", "_"):
            return item
    hint = did_you_mean(name, (item.name for item in REGISTERS))
    hint = hint or "give an address such as 0x0130; `ecatctl reg-read SLAVE` lists all names"
    raise UsageError(f"there is no register '{name}': {hint}")


def register_at(address: int) -> Register | None:
    """The register that begins at an address, or None."""
    return next((item for item in REGISTERS if item.address == address), None)


def register_text(name: str) -> str:
    """The description of a register by its name."""
    return next(item.text for item in REGISTERS if item.name == name)


def controlled(address: int, size: int) -> list[str]:
    """What the daemon itself controls with these registers while it runs the bus."""
    return [text for first, end, text in _CONTROLLED if address < end and first < address + size]
