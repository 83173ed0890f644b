"""Texts about slaves whose process data are in doubt, and what to do about them."""

SILENT, DAMAGED, UNEXPECTED = "silent", "damaged", "unexpected"
CONTRADICTED, UNREADABLE, STUCK = "contradicted", "unreadable", "stuck"

REMEDIES = {
    SILENT: "switch it off and on, then restart ecatd",
    DAMAGED: "write its EEPROM again, from the ESI file of its vendor, then restart ecatd",
    CONTRADICTED: "choose the right one with pdo_source in its [[slave]] table, then restart ecatd "
    "(`ecatctl config check --esi` compares with its ESI file, too)",
    UNREADABLE: 'describe it with pdo_source = "configuration" and [[slave.pdo]] in its [[slave]] '
    "table, then restart ecatd",
    STUCK: "remove the reason, then restart ecatd",
}
