"""How models reach a bus elsewhere: a table of facts with their sources, and what was measured."""

from __future__ import annotations

from typing import Any

from ..words import us

_NS = "{:.0f} ns"

_SOURCES = """\
Measured are the cells with a time; all others are from the sources named here. *In the model's \
process* is how the DLR EtherCAT Library does it, whose blocks call a master that lives and dies \
with the model; here that master is SOEM, through [pysoem](https://github.com/bnjmnp/pysoem), \
with the same slaves. *DeviceDrivers* is `MDDSharedMemory.h` of [Modelica_DeviceDrivers]\
(https://github.com/modelica-3rdparty/Modelica_DeviceDrivers/tree/f0ea4af); it is memory and no \
bus, so somebody else has to exchange. It is measured where `DEVICE_DRIVERS` names a checkout of \
it: `make bench DEVICE_DRIVERS=folder`. *Diamond* is `scanner.c` of [DiamondLightSource/ethercat]\
(https://github.com/DiamondLightSource/ethercat/tree/b1c8fdd); it was not built, since it needs \
the kernel module of IgH. *EtherDOG* is \
[Autonomy-Logic/EtherDOG](https://github.com/Autonomy-Logic/EtherDOG), from its \
`docs/PROTOCOL.md` and `docs/BUSCONFIG.md`; it was not built: its exchange is that of SOEM, which \
is measured here, and what it adds for the model are two datagrams over loopback."""


def comparison(result: dict[str, Any]) -> str:
    """The table, in Markdown."""
    head = ("", "ecatd", "in the model's process", "DeviceDrivers", "Diamond", "EtherDOG")
    lines = [head, ("---",) * len(head), *_rows(result)]
    rows = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    return f"{rows}\n\n{_SOURCES}"


def _rows(result: dict[str, Any]) -> list[tuple[str, ...]]:
    drivers, master = result["peers"]["device_drivers"], result["peers"]["in_process"]
    step = result["commits"][0]["step"]
    reads = f"{_NS.format(drivers['reads'])} (20 reads)" if "reads" in drivers else "not measured"
    exchange = f"{us(master['step'])} µs" if "step" in master else "not measured"
    return [
        (
            "time in the model's step",
            f"{_NS.format(step)} (sample, 20 reads, 4 writes, commit)",
            f"{exchange}: the exchange itself, with the wire",
            reads,
            "–",
            "–",
        ),
        (
            "rate",
            "any; each domain a divider of it",
            "the model's; a late step is a late frame",
            "the model's",
            "1 kHz, compiled in",
            "configured, 1 ms by default",
        ),
        (
            "copies a cycle",
            "1 for all readers, 1 for each sample",
            "none",
            "1 for each side",
            "1 into a message, then 1 for each client through a socket",
            "1 datagram in each direction",
        ),
        (
            "system calls in the step",
            "none",
            "send and receive for each frame",
            "none, or a futex when the semaphore is taken",
            "reads from a stream socket",
            "receive and send a datagram",
        ),
        (
            "clients",
            "any number of readers, 32 that write",
            "1",
            "any number, all may write",
            "10",
            "1 for process data; a new one replaces it",
        ),
        (
            "who owns an output",
            "one client for each entry, granted by the daemon",
            "the process",
            "nobody",
            "nobody: the last write counts",
            "the one client",
        ),
        (
            "torn or stale data",
            "excluded; age and working counter with every sample",
            "excluded",
            "excluded; no age",
            "excluded; cycle and working counter",
            "excluded; sequence and flags",
        ),
        (
            "the model crashes",
            "its outputs go to their safe values within its lease; the bus goes on",
            "the bus stands still; watchdogs of slaves",
            _dead(drivers),
            "its outputs stay as they are",
            "all outputs zero after 100 ms",
        ),
        (
            "the daemon crashes",
            "clients are told within 100 ms and go on with the next one",
            "–",
            "–",
            "the socket is closed",
            "datagrams end",
        ),
    ]


def _dead(drivers: dict[str, Any]) -> str:
    if drivers.get("waits", True):
        tried = " (tried)" if "waits" in drivers else ""
        return f"holding the semaphore: all others wait for ever{tried}"
    return "values stay as they are"
