"""Words for slaves whose process data are in doubt, and what mends that."""

SILENT, DAMAGED, UNEXPECTED = "silent", "damaged", "unexpected"

REMEDIES = {
    SILENT: "switch it off and on, then restart ecatd",
    DAMAGED: "write its EEPROM anew, from the ESI file of its vendor, then restart ecatd",
}
