"""Reads devices and rigs from files: SII images, ESI, TOML, Python."""
