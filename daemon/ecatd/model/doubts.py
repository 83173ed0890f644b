"""Texts about slaves whose process data are in doubt, and what to do about them."""

SILENT, DAMAGED, UNEXPECTED = "silent", "damaged", "unexpected"

REMEDIES = {
    SILENT: "switch it off and on, then restart ecatd",
    DAMAGED: "write its EEPROM again, from the ESI file of its vendor, then restart ecatd",
}
