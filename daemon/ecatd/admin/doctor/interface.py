"""Checks a network interface with EtherCAT slaves."""

from __future__ import annotations

import fcntl
import socket
import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from ecatd.base.errors import UnreachableError
from ecatd.linux import ethtool
from ecatd.linux.interface_state import InterfaceState, read_interfaces, remarks

from .findings import Area, Finding
from .settings import Change, read

_SIOCGIFADDR = 0x8915
_OF_LINK = ("speed", "duplex")
_JOINS = "is on: {} tries in vain to join EtherCAT frames, which takes time"
_SETTINGS = {
    # what is best; the name of the finding; what another value does; what changes it
    "coalescing": (
        "rx 0 tx 0 adaptive off",
        "interrupt coalescing",
        "{}: the card delays its interrupt by that many µs",
        "-C {} adaptive-rx off rx-usecs 0 tx-usecs 0",
    ),
    "gro": ("off", "offloads", f"gro {_JOINS.format('the kernel')}", "-K {} gro off"),
    "lro": ("off", "offloads", f"lro {_JOINS.format('the card')}", "-K {} lro off"),
    "eee": (
        "off",
        "sleep of the port",
        "Energy-Efficient Ethernet is on: the port sleeps between the cycles",
        "--set-eee {} eee off",
    ),
}
"""The settings of `ethtool` that delay frames."""


def look_at(interface: str, cpu: int | None) -> Iterator[Finding]:
    """Findings about an interface.

    Args:
        interface: Its name.
        cpu: `realtime.cpu` of the configuration.
    """
    try:
        for state in read_interfaces([interface]):
            yield from look_at_state(state, cpu)
            return
    except UnreachableError as error:
        remedy = "run it where the kernel answers, for example outside of the container"
        yield _area(interface).problem("interface", str(error), remedy)
        return
    names = ", ".join(sorted(name for _, name in socket.if_nameindex()))
    text = f"there is no interface of this name, only {names}"
    remedy = "correct 'interface' in the configuration, or look at `dmesg` for the card"
    yield _area(interface).problem("interface", text, remedy)


def look_at_state(
    state: InterfaceState, cpu: int | None, root: Path = Path("/")
) -> Iterator[Finding]:
    """Findings about an interface of this machine.

    Args:
        state: What the kernel knows of it.
        cpu: `realtime.cpu` of the configuration.
        root: The folder with `sys` and `proc`.
    """
    area, folder = _area(state.name), root / "sys/class/net" / state.name
    yield _driver(area, folder)
    yield from _link(area, state)
    yield _addresses(area, state.name)
    yield from _settings(area, state.name)
    yield from _interrupts(area, folder, cpu, root / "proc/irq")


def _area(interface: str) -> Area:
    return Area(f"interface {interface}")


def _driver(area: Area, folder: Path) -> Finding:
    driver = folder / "device/driver"
    if not driver.exists():
        text = "it is a virtual interface, without a network card"
        remedy = "this is right for a simulation; for real slaves, name an Ethernet port of this "
        "machine"
        return area.hint("driver", text, remedy)
    name = driver.resolve().name
    if (folder / "wireless").exists():
        text = f"{name}: a radio, not an Ethernet port"
        return area.problem("driver", text, "use an Ethernet port")
    if "usb" in str((folder / "device").resolve()):
        text = f"{name}, connected by USB: each frame waits for the USB, up to some 100 µs"
        return area.hint("driver", text, "use a PCIe card")
    return area.ok("driver", name)


def _link(area: Area, state: InterfaceState) -> Iterator[Finding]:
    """The link, and who else uses it."""
    found = [item for item in remarks(state) if item.topic != "offload"]  # see `_settings`
    if not state.up:
        text = "it is switched off; ecatd switches it on when it starts"
        yield area.ok("link", text)
    elif not state.carrier:
        remedy = "check the cable and the power of the first slave, and that this is the right "
        "interface"
        yield area.problem("link", "no carrier", remedy)
    elif not any(item.topic in _OF_LINK for item in found):
        speed = f"{state.speed} Mbit/s, {state.duplex} duplex" if state.speed else "carrier"
        yield area.ok("link", speed)
    for item in found:
        tell = area.problem if item.is_fault else area.hint
        yield tell("link" if item.topic in _OF_LINK else item.topic, item.text, item.remedy)


def _addresses(area: Area, interface: str) -> Finding:
    addresses = [*_ipv4(interface), *_ipv6(interface)]
    if not addresses:
        return area.ok("IP addresses", "none")
    text = f"{', '.join(addresses)}: other programs send their frames to the slaves"
    remedy = (
        "name the interface in /etc/ecatd/BUS.toml and run `udevadm trigger --action=change "
        f"--subsystem-match=net`, with NetworkManager also `nmcli device set {interface} "
        f"managed no`; then `ip addr flush dev {interface}`"
    )
    return area.hint("IP addresses", text, remedy)


def _ipv4(interface: str) -> list[str]:
    request = struct.pack("16s24x", interface.encode())
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control, suppress(OSError):
        answer = fcntl.ioctl(control, _SIOCGIFADDR, request)
        return [socket.inet_ntoa(answer[20:24])]
    return []


def _ipv6(interface: str) -> list[str]:
    """Global addresses. Each interface also has a local one, which does no harm."""
    found = []
    for line in read(Path("/proc/net/if_inet6")).splitlines():
        address, _, _, scope, _, name = line.split()
        if name == interface and scope == "00":
            found.append(socket.inet_ntop(socket.AF_INET6, bytes.fromhex(address)))
    return found


def _settings(area: Area, interface: str) -> Iterator[Finding]:
    for setting, (best, name, text, command) in _SETTINGS.items():
        with suppress(OSError):  # the driver does not report it
            found = ethtool.read(interface, setting)
            if found == best:
                yield area.ok(name, f"{setting} is off")
            else:
                remedy = f"`ethtool {command.format(interface)}`"
                change = Change(f"{interface} {setting}", best)
                yield area.hint(name, text.format(found), remedy, change)


def _interrupts(area: Area, folder: Path, cpu: int | None, irqs: Path) -> Iterator[Finding]:
    """Finds the processors that handle the interrupts of the card."""
    numbers = [path.name for path in (folder / "device/msi_irqs").glob("*")]
    if not numbers and (single := read(folder / "device/irq")) not in ("", "0"):
        numbers = [single]
    for number in sorted(numbers, key=int):
        file = irqs / number / "smp_affinity_list"
        where = read(file)
        if not where:
            continue
        if cpu is None or where == str(cpu):
            yield area.ok("interrupts", f"IRQ {number} on CPU {where}")
        else:
            text = f"IRQ {number} goes to CPU {where}, the engine runs on CPU {cpu}"
            remedy = f"`echo {cpu} >{file}`; irqbalance must not move it back"
            yield area.hint("interrupts", text, remedy, Change(f"IRQ {number}", str(cpu)))
