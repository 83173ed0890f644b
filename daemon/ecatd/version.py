"""The version, in one place for Python and the package."""

VERSION = "0.1.0"
