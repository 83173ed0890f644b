"""Checks a network interface with EtherCAT slaves."""

from __future__ import annotations

import fcntl
import socket
import struct
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path

from ecatd.linux import ethtool
from ecatd.linux.interface_state import (
    LEAST_MTU,
    InterfaceState,
    bridge_remark,
    remarks,
    speed_remarks,
)

from .findings import Change, Finding, Level
from .values import ROOT, read, text_change

_SIOCGIFADDR = 0x8915
_NETWORK = "sys/class/net"
_COALESCING_OFF = "rx 0 tx 0 adaptive off"


def look_at(interface: str, cpu: int | None, root: Path = ROOT) -> Iterator[Finding]:
    """Findings about an interface.

    Args:
        interface: Its name.
        cpu: `realtime.cpu` of the configuration.
        root: The folder with `sys` and `proc`.
    """
    area = f"interface {interface}"
    folder = root / _NETWORK / interface
    if not folder.exists():
        names = ", ".join(sorted(path.name for path in folder.parent.iterdir()))
        text = f"there is no interface of this name, only {names}"
        remedy = "correct 'interface' in the configuration, or look at `dmesg` for the card"
        yield Finding(area, "interface", Level.PROBLEM, text, remedy)
        return
    yield _driver(area, folder)
    yield _link(area, interface, folder)
    yield from _users(area, interface, folder)
    yield from _settings(area, interface)
    yield from _interrupts(area, folder, cpu, root / "proc/irq")


def _driver(area: str, folder: Path) -> Finding:
    driver = folder / "device/driver"
    if not driver.exists():
        text = "it is a virtual interface, which has no card"
        remedy = "for slaves that are no simulation, name an Ethernet port of this machine"
        return Finding(area, "driver", Level.HINT, text, remedy)
    name = driver.resolve().name
    if (folder / "wireless").exists():
        remedy = "use an Ethernet port"
        return Finding(
            area, "driver", Level.PROBLEM, f"{name}: a radio, not an Ethernet port", remedy
        )
    if "usb" in str((folder / "device").resolve()):
        text = f"{name}, connected by USB: each frame waits for the USB, up to some 100 µs"
        return Finding(area, "driver", Level.HINT, text, "use a PCIe card")
    return Finding(area, "driver", Level.OK, name)


def _link(area: str, interface: str, folder: Path) -> Finding:
    if read(folder / "carrier") != "1":
        if not int(read(folder / "flags") or "0", 16) & 1:
            text = "it is switched off; ecatd switches it on when it starts"
            return Finding(area, "link", Level.OK, text)
        remedy = "check cable and power of the first slave, and that this is the right interface"
        return Finding(area, "link", Level.PROBLEM, "no carrier", remedy)
    speed, duplex = read(folder / "speed"), read(folder / "duplex")
    if speed in ("", "-1") or not (folder / "device").exists():
        return Finding(area, "link", Level.OK, "carrier")
    text = f"{speed} Mbit/s, {duplex} duplex"
    state = InterfaceState(interface, speed=int(speed), duplex=duplex)
    for remark in speed_remarks(state):
        level = Level.PROBLEM if remark.is_fault else Level.HINT
        return Finding(area, "link", level, remark.text, remark.remedy)
    return Finding(area, "link", Level.OK, text)


def _users(area: str, interface: str, folder: Path) -> Iterator[Finding]:
    """Finds other users of the interface."""
    addresses = [*_ipv4(interface), *_ipv6(interface)]
    if addresses:
        text = f"{', '.join(addresses)}: other programs send their frames to the slaves"
        remedy = (
            "name the interface in /etc/ecatd/BUS.toml and run `udevadm trigger --action=change "
            f"--subsystem-match=net`, with NetworkManager also `nmcli device set {interface} "
            f"managed no`; then `ip addr flush dev {interface}`"
        )
        yield Finding(area, "IP addresses", Level.HINT, text, remedy)
    else:
        yield Finding(area, "IP addresses", Level.OK, "none")
    if (folder / "master").exists():
        remark = bridge_remark(interface, (folder / "master").resolve().name)
        yield Finding(area, "bridge", Level.PROBLEM, remark.text, remark.remedy)
    yield from _shared(area, interface, folder)


def _shared(area: str, interface: str, folder: Path) -> Iterator[Finding]:
    """Finds an MTU that is too small, and what shares the cable with the slaves."""
    above = tuple(sorted(path.name.removeprefix("upper_") for path in folder.glob("upper_*")))
    mtu, kind = read(folder / "mtu"), _kind(folder)
    bridge = (folder / "master").resolve().name if (folder / "master").exists() else ""
    state = InterfaceState(
        interface,
        mtu=int(mtu) if mtu else LEAST_MTU,
        kind=kind,
        above=tuple(name for name in above if name != bridge),
    )
    for remark in remarks(state):
        yield Finding(area, remark.topic, Level.PROBLEM, remark.text, remark.remedy)


def _kind(folder: Path) -> str:
    """Kind of a virtual interface, such as `vlan`; empty for a card."""
    lines = dict(line.partition("=")[::2] for line in read(folder / "uevent").splitlines())
    return lines.get("DEVTYPE", "")


def _settings(area: str, interface: str) -> Iterator[Finding]:
    with suppress(OSError):
        found = ethtool.coalescing(interface)
        name = f"{interface} coalescing"
        get, put = (
            partial(ethtool.coalescing, interface),
            partial(ethtool.set_coalescing, interface),
        )
        if found == _COALESCING_OFF:
            yield Finding(area, "interrupt coalescing", Level.OK, "off")
        else:
            yield Finding(
                area,
                "interrupt coalescing",
                Level.HINT,
                f"{found}: the card delays its interrupt by that many µs",
                f"`ethtool -C {interface} adaptive-rx off rx-usecs 0 tx-usecs 0`",
                Change(name, get, put, _COALESCING_OFF),
            )
    on = []
    for name in ethtool.OFFLOADS:
        with suppress(OSError):
            if ethtool.offload(interface, name) == "on":
                on.append(name)
    if not on:
        yield Finding(area, "offloads", Level.OK, "off")
    for name in on:
        change = Change(
            f"{interface} {name}",
            partial(ethtool.offload, interface, name),
            partial(ethtool.set_offload, interface, name),
            "off",
        )
        who = "the kernel" if name == "gro" else "the card"
        text = f"{name} is on: {who} tries in vain to join EtherCAT frames, which takes time"
        remedy = f"`ethtool -K {interface} {name} off`"
        yield Finding(area, "offloads", Level.HINT, text, remedy, change)
    with suppress(OSError):
        if ethtool.energy_efficient(interface) == "on":
            change = Change(
                f"{interface} eee",
                partial(ethtool.energy_efficient, interface),
                partial(ethtool.set_energy_efficient, interface),
                "off",
            )
            text = "Energy-Efficient Ethernet is on: the port sleeps between the cycles"
            remedy = f"`ethtool --set-eee {interface} eee off`"
            yield Finding(area, "sleep of the port", Level.HINT, text, remedy, change)


def _interrupts(area: str, folder: Path, cpu: int | None, irqs: Path) -> Iterator[Finding]:
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
            text = f"IRQ {number} on CPU {where}"
            yield Finding(area, "interrupts", Level.OK, text)
        else:
            text = f"IRQ {number} goes to CPU {where}, the engine runs on CPU {cpu}"
            remedy = f"`echo {cpu} >{file}`; irqbalance must not move it back"
            change = text_change(f"IRQ {number}", file, str(cpu))
            yield Finding(area, "interrupts", Level.HINT, text, remedy, change)


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
