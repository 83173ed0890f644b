"""All kinds of events: their facts, how bad they are, and what to do.

A new kind is a row of `KINDS` and the place that tells it: with `new_event`, to the log with its
name, or both. The row also makes its lines in `docs/troubleshooting.md`, `docs/zenoh-keys.md` and
`systemd/ecatd.catalog`. A new fact is a row of `FACTS`, and means the same in all kinds.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, NamedTuple


class Fact(NamedTuple):
    """Something that events say."""

    type: Any  #: Type of its value.
    meaning: str  #: What it is.
    #: Whether an event is about it: a flood of events of a kind about the same thing is gathered.
    subject: bool = False


FACTS: Mapping[str, Fact] = {
    "slave": Fact(int, "position of the slave", subject=True),
    "port": Fact(int, "port of the slave", subject=True),
    "before": Fact(int, "position of the slave at the other end of the link; -1: the master"),
    "before_port": Fact(int, "its port; of the master: 0, or 1 for the second interface"),
    "verdict": Fact(str, "how the cable is"),
    "worse": Fact(
        float, "how many times as many errors as in the 24 hours before; 0: that is no alarm"
    ),
    "slaves": Fact(list[int], "positions of the slaves that it concerns, or that explain it"),
    "missing": Fact(list[int], "positions of slaves that do not answer"),
    "found": Fact(int, "slaves that answer"),
    "expected": Fact(int, "slaves of the bus"),
    "differences": Fact(list[str], "a text for each device that is not as expected"),
    "domain": Fact(int | None, "number of the domain; None if it is about none", subject=True),
    "interface": Fact(str, "name of the interface", subject=True),
    "slot": Fact(int, "slot of the client in the shared memory", subject=True),
    "program": Fact(str, "program of the client, by its own account"),
    "pid": Fact(int, "its process ID, by its own account"),
    "programs": Fact(list[str], "processes that may have written into the file, or have it open"),
    "lease_ms": Fact(float, "lease of the client"),
    "silent_ms": Fact(float, "time from its last sign of life until its outputs became safe"),
    "process": Fact(str, "how its process was then, as in Outputs; not there: not known"),
    "owner": Fact(str, "the client that owns the output"),
    "entry": Fact(str, "address of the entry, such as `0x7000:01`"),
    "file": Fact(str, "path of the file", subject=True),
    "what": Fact(str, "what was changed", subject=True),
    "by": Fact(str, "who has asked for it"),
    "failed": Fact(bool, "whether it has failed"),
    "state": Fact(str, "the new state"),
    "al_state": Fact(int, "AL status (register 0x0130)"),
    "al_code": Fact(int, "AL status code (register 0x0134)"),
    "code": Fact(int, "error code"),
    "register": Fact(int, "error register"),
    "error": Fact(str, "why the system refuses them; empty: it accepts them again"),
    "damage": Fact(str, "what was done to it"),
    "reason": Fact(str, "why, as in `ecatctl claims --json`"),
    "fault": Fact(str, "what fails"),
    "topic": Fact(str, "what it is about"),
    "counts": Fact(dict[str, int], "by how much each counter has grown"),
    "count": Fact(int, "frames"),
    "source": Fact(str, "source address of the frames"),
    "wrote": Fact(list[str], "what it has written, such as `FMMUs (0x0600) of all slaves`"),
    "share": Fact(float, "share of the exchanges that fail, 0 to 1"),
    "exchanges": Fact(int, "exchanges that were counted"),
    "failures": Fact(int, "how many of them have failed"),
    "seconds": Fact(float, "how long that took"),
    "over": Fact(bool, "whether it is over"),
    "in_time": Fact(bool, "whether the drive stopped in time"),
    "slaves_before": Fact(int, "number of slaves before the break"),
    "offset_ns": Fact(int, "phase of the cycle to the reference clock"),
    "drift_ppb": Fact(int, "how much faster the reference clock runs than CLOCK_MONOTONIC"),
    "difference_ns": Fact(int, "difference to the reference clock"),
    "cycle": Fact(int, "number of the cycle that it is about; `time_ns` is then its time"),
}


SEVERITIES = ("error", "warning", "notice", "info")
"""How bad events can be, the worst first."""


class Kind(NamedTuple):
    """A kind of event."""

    name: str  #: Its name: `event` of the event, and `ECAT_EVENT` of its lines in the journal.
    #: One of `SEVERITIES`: the level of its lines in the log at worst; what is good news has
    #: `info`.
    severity: str
    subject: str  #: What has happened, without a full stop.
    #: Sentences in Markdown that say more, and what to do; `{bus}` and `{slave}` stand for the
    #: names.
    advice: str
    #: Facts of each such event beside `text`; those with a `?` are not always there.
    facts: tuple[str, ...] = ()
    values: Mapping[str, str] = {}  #: The values that a fact of this kind can have, by its name.
    published: bool = True  #: Whether it comes over Zenoh, and with `ecatctl events`.
    logged: bool = True  #: Whether lines of the log have its name.


KINDS: Mapping[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind(
            "al_state",
            "warning",
            "The AL state of a slave has changed",
            "It has left OP or come back to it, or has reported an error (AL status code). ecatd "
            "brings a slave without an error of its own back. Otherwise the text says why, and "
            "what to do. Then run `ecatctl state {slave} OP`.",
            ("slave", "al_state", "al_code", "cycle?"),
        ),
        Kind(
            "slaves",
            "error",
            "Slaves have left the wire or come back",
            "Check the power of the slaves that the text names, and the cable before the first of "
            "them. ecatd sets them up again as soon as they answer.",
            ("found", "expected", "missing", "cycle?"),
        ),
        Kind(
            "absent",
            "info",
            "Optional slaves have left the bus",
            "They may come and go. The event `recovery` tells when they are back.",
            ("slaves", "cycle?"),
        ),
        Kind(
            "recovery",
            "error",
            "ecatd brings a slave back to OP, or cannot do so",
            "A slave with the state `refused` has a fault of its own. Mend it, then run `ecatctl "
            "state {slave} OP`.",
            ("slave", "state", "seconds?", "cycle?"),
            {
                "state": (
                    "`fallen`, `asked`, `set_up`, `recovered` (with `seconds`), `joined`, `slow`, "
                    "`waiting`, `missing`, `exchanged` or `refused`"
                )
            },
        ),
        Kind(
            "emergency",
            "warning",
            "A slave has sent an emergency",
            "It reports a fault of its own (CoE emergency). The manual of the device explains the "
            "error code. Object 0x1003 may have the faults before it: `ecatctl sdo-read {slave} "
            "0x1003 1`.",
            ("slave", "code", "register"),
        ),
        Kind(
            "drive",
            "error",
            "A drive reports a fault of its own, or no longer does",
            "Its statusword says so (CiA 402, Fault). It stays in OP, but does not follow its "
            "targets. Mend the cause, then reset the fault with a rising edge of bit 7 of the "
            "controlword. Object 0x1003 may have the faults before it: `ecatctl sdo-read {slave} "
            "0x1003 1`.",
            ("slave", "code", "over", "cycle"),
            {"code": "that of object 0x603F; 0: not known"},
        ),
        Kind(
            "link",
            "error",
            "The link of an interface has changed",
            "Check the cable to the first slave, its power, and whether another program manages "
            "the interface.",
            ("interface", "state"),
            {"state": "`up`, `no_carrier`, `down` or `gone`"},
        ),
        Kind(
            "sending",
            "error",
            "An interface refuses frames, or accepts them again",
            "The text has the reason of the system. `ecatctl stats` counts them as `unsent`.",
            ("interface", "error", "cycle"),
        ),
        Kind(
            "ring",
            "error",
            "The ring has opened or closed",
            "With cable redundancy the bus goes on with a broken cable, but a second break would "
            "cost slaves. The text says between which slaves the break is: mend it soon.",
            ("state", "slaves_before", "cycle"),
            {"state": "`closed` or `open`"},
        ),
        Kind(
            "disturbance",
            "warning",
            "Error counters are rising, or have stopped rising",
            "Frames did not come back in their cycle, or the computer did not get to the cycle in "
            "time. Cables and plugs cause lost frames; other programs, power management and "
            "drivers cause missed cycles. See: `ecatctl stats`, `ecatctl info`.",
            ("counts", "seconds", "over"),
        ),
        Kind(
            "cable",
            "warning",
            "A cable has become strained or bad, or is good again",
            "The error counters at its ends rise, or its link is lost now and then. The text says "
            "which cable it is, and what to do: [which cable](commissioning.md#which-cable). See: "
            "`ecatctl errors`.",
            ("slave", "port", "before", "before_port", "verdict", "worse"),
            {"verdict": "`good`, `strained` or `bad`"},
        ),
        Kind(
            "foreign_master",
            "error",
            "Another EtherCAT master sends frames",
            "Two masters undo each other's outputs and states: stop the other one, or give it "
            "slaves of its own.",
            ("interface", "source", "count", "wrote", "over"),
        ),
        Kind(
            "working_counter",
            "info",
            "Slaves have stopped or begun to take part in the exchange of a domain",
            "`times` says how often that has changed since the event before. If it goes on, the "
            "event `exchange` says why.",
            ("domain", "state", "cycle"),
            {"state": "`zero`, `incomplete` or `complete`"},
            logged=False,
        ),
        Kind(
            "exchange",
            "error",
            "Exchanges of a domain begin to fail, for another reason, or succeed again",
            "Slaves do not take part as they should, or frames are lost. The text says why, and "
            "what to do. See: `ecatctl check`.",
            ("fault", "domain", "share", "exchanges", "failures", "slaves", "over"),
            {"fault": "`working_counter`, `lost`, `late` or `unsent`"},
        ),
        Kind(
            "interface",
            "warning",
            "An interface has a problem, or no longer has it",
            "The text says what, and what to do. See: `ecatctl doctor`.",
            ("interface", "topic", "over"),
            {"topic": "`mtu`, `duplex`, `speed`, `bridge`, `vlan` or `offload`"},
        ),
        Kind(
            "clock",
            "warning",
            "The cycle follows the reference clock, or no longer does",
            "Without it, slaves with SYNC signals may leave OP. See: `ecatctl dc`, and "
            "[distributed clocks](distributed-clocks.md).",
            ("state", "offset_ns", "drift_ppb", "cycle"),
        ),
        Kind(
            "clock_difference",
            "warning",
            "The clock of a slave is out of step, or in step again",
            "See: `ecatctl dc`, and [distributed clocks](distributed-clocks.md).",
            ("slave", "difference_ns"),
        ),
        Kind(
            "expected_bus",
            "error",
            "The bus differs from the configuration, or matches it again",
            "Its slaves differ from the tables `[[slave]]` of [the expected "
            "bus](configuration.md#the-expected-bus). See: `ecatctl config check FILE`.",
            ("differences",),
            {"differences": "empty: the bus is as expected again"},
        ),
        Kind(
            "change",
            "notice",
            "Somebody has asked for a change, or for a file of a slave",
            "It is also in the [audit file](configuration.md#the-audit-file).",
            ("what", "by", "failed"),
            logged=False,
        ),
        Kind(
            "configuration",
            "error",
            "The configuration was read again",
            "The log says which keys have changed, or what is wrong in the file. The event comes "
            "if something has changed. See: `ecatctl config show`.",
        ),
        Kind(
            "log_levels",
            "notice",
            "Levels of the log have changed",
            "See: `ecatctl log-level`.",
            logged=False,
        ),
        Kind(
            "claimed",
            "info",
            "A client owns outputs of a slave",
            "Until it releases them, nobody else can write them. See: `ecatctl claims`.",
            ("slave", "slot", "program", "pid", "cycle"),
        ),
        Kind(
            "conflict",
            "info",
            "A client was refused outputs that another client owns",
            "The text names both. Release the outputs in the other client, or let only one of "
            "them write. See: `ecatctl claims`.",
            ("slave", "entry", "owner", "slot", "program", "pid", "cycle"),
        ),
        Kind(
            "safe",
            "error",
            "Outputs of a slave are safe",
            "They have their [safe values](configuration.md#safe-outputs), because their client "
            "has ended, hangs, or gave them back, or because the bus is stopped. The client is "
            "the one before, if there was one. See: `ecatctl claims`.",
            (
                *("slave", "reason", "slot?", "program?", "pid?"),
                *("lease_ms?", "silent_ms?", "process?", "cycle"),
            ),
        ),
        Kind(
            "stopped",
            "warning",
            "A drive was brought to a stop",
            "It had lost its client. If it did not stop in time, check its ramp and "
            "`stop_timeout_s` of the configuration.",
            ("slave", "in_time", "slot?", "program?", "pid?", "cycle"),
        ),
        Kind(
            "refused",
            "warning",
            "A client wrote a value outside its declared range",
            "It was not sent. Mend the client, or the limits in the configuration.",
            ("slave", "entry", "slot", "program", "pid", "programs", "cycle"),
        ),
        Kind(
            "can_state",
            "warning",
            "The CAN controller of a terminal has another state",
            "With errors, check cable and termination of the CAN bus, the bit rate of all nodes, "
            "and that at least one other node is on. ecatd has a terminal that is bus-off take "
            "part again after `bus_off_restart_ms` of its [slave.can](can.md#bus-off). See: "
            "`ecatctl can stats`.",
            ("slave", "state", "cycle"),
            {"state": "`stopped`, `active`, `warning`, `passive` or `bus_off`"},
        ),
        Kind(
            "can_ended",
            "warning",
            "A client no longer sends on a CAN channel",
            "If it has not ended in order, its frames that waited were dropped, and the "
            "[safe frames](can.md#safe-frames) are sent.",
            ("slave", "reason", "slot", "program", "pid", "cycle"),
        ),
        Kind(
            "can_refused",
            "warning",
            "A CAN frame of a client was not sent",
            "Another client has reserved its identifier, or no client library writes such a frame. "
            "See: `ecatctl can stats`.",
            ("slave", "slot", "program", "pid", "cycle"),
        ),
        Kind(
            "can_conflict",
            "info",
            "A client was refused CAN identifiers that another client has reserved",
            "The text names both. See: `ecatctl can stats`.",
            ("slave", "owner", "slot", "program", "pid", "cycle"),
        ),
        Kind(
            "can_overflow",
            "warning",
            "A terminal has lost CAN frames that it received",
            "Its queue was full. Exchange it more often, or let [filters](can.md#configuration) "
            "pass only what is needed.",
            ("slave", "cycle"),
        ),
        Kind(
            "can_malformed",
            "warning",
            "A CAN terminal has delivered a batch that cannot be",
            "It says that there are more frames than its process data have room for. Check the "
            "layout in its [slave.can](can.md#configuration).",
            ("slave", "cycle"),
        ),
        Kind(
            "malformed",
            "warning",
            "A client slot contains data that no client library writes",
            "It was not used. The text names the programs that may have done it, except those "
            "that ecatd cannot see: a service sees no programs of other users. To list all "
            "programs that have the file open now, run `sudo fuser -v /dev/shm/ecat/{bus}.out`.",
            ("slot", "program", "pid", "programs", "cycle"),
        ),
        Kind(
            "tampered",
            "warning",
            "A file of the shared memory was changed by another process",
            "The text names the programs that have it open, except those that ecatd cannot see: "
            "a service sees no programs of other users. To list all programs that have it open "
            "now, run `sudo fuser -v /dev/shm/ecat/{bus}*`.",
            ("file", "damage", "programs"),
            {
                "damage": (
                    "`cut short`, `written over`, `given other rights`, `replaced` or `removed`"
                )
            },
        ),
        Kind(
            "in_op",
            "info",
            "The bus is in OP",
            "All slaves that have to be there are in OP, and clients can use them.",
            published=False,
        ),
        Kind(
            "failed",
            "error",
            "The bus has not started",
            "The message says why, and what to do. systemd tries again, unless the configuration "
            "is wrong.",
            published=False,
        ),
        Kind(
            "ended",
            "error",
            "A process of ecatd has ended unexpectedly",
            "The service ends, and systemd starts it again. If nobody has killed the process, "
            "please report this, with the log.",
            published=False,
        ),
        Kind(
            "hung",
            "error",
            "A process of ecatd hangs",
            "It did not answer for ten seconds, so ecatd kills it, and systemd starts the "
            "service again. Please report this, with the log, unless somebody has stopped the "
            "process.",
            published=False,
        ),
        Kind(
            "gateway",
            "error",
            "The gateway is started again",
            "It has ended or hangs. The bus goes on; requests and monitoring over the network "
            "were interrupted for some seconds.",
            published=False,
        ),
        Kind(
            "recorder",
            "error",
            "The flight recorder is started again",
            "It has ended or hangs. The bus goes on; an incident meanwhile was not recorded.",
            published=False,
        ),
        Kind(
            "ros",
            "error",
            "The node of ROS 2 is started again",
            "It has ended or hangs. The bus goes on; ROS 2 saw nothing of it for some seconds.",
            published=False,
        ),
        Kind(
            "incident",
            "info",
            "Somebody has asked for an incident",
            "The flight recorder writes it. See: `ecatctl incident list`.",
            ("by",),
            logged=False,
        ),
        Kind(
            "incident_written",
            "warning",
            "An incident is in a file, or cannot be written",
            "Something has gone wrong on the bus, or somebody has asked for it. `ecatctl incident "
            "show NAME` says what is known. See: [incidents](incidents.md).",
            published=False,
        ),
    )
}

PUBLISHED = frozenset(name for name, kind in KINDS.items() if kind.published)
"""The kinds that come over Zenoh."""


def new_event(kind: str, *, text: str, severity: str = "", **facts: Any) -> dict[str, Any]:
    """Makes an event of now, as it is published. One about a cycle gets the time of that cycle.

    Args:
        kind: One of `PUBLISHED`.
        text: What has happened, as a sentence.
        severity: One of `SEVERITIES`, if it is not that of the kind.
        facts: The other facts that its row of `KINDS` names.
    """
    return {
        "event": kind,
        "severity": severity or KINDS[kind].severity,
        "time_ns": time.time_ns(),
        **facts,
        "text": text,
    }
