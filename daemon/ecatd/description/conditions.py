"""What is known of a slave that is not in OP, or whose process data are uncertain."""

from __future__ import annotations

from enum import StrEnum


class Condition(StrEnum):
    """The condition of a slave, as `recovery` has it in the states of slaves."""

    FINE = ""
    ABSENT = "absent"  # an optional slave that is not there
    MISSING = "missing"
    EXCHANGED = "exchanged"
    RECOVERING = "recovering"
    WAITING = "waiting"
    REFUSED = "refused"
    LEFT = "left"
    # Its process data are uncertain since the start.
    SILENT = "silent"
    DAMAGED = "damaged"
    UNEXPECTED = "unexpected"
    CONTRADICTED = "contradicted"
    UNREADABLE = "unreadable"
    STUCK = "stuck"


REMEDIES = {
    Condition.SILENT: "switch it off and on, then restart ecatd",
    Condition.DAMAGED: "write its EEPROM again, from the ESI file of its vendor, then restart "
    "ecatd",
    Condition.CONTRADICTED: "choose the right one with pdo_source in its [[slave]] table, then "
    "restart ecatd (`ecatctl config check --esi` compares with its ESI file, too)",
    Condition.UNREADABLE: 'describe it with pdo_source = "configuration" and [[slave.pdo]] in its '
    "[[slave]] table, then restart ecatd",
    Condition.STUCK: "remove the reason, then restart ecatd",
}
