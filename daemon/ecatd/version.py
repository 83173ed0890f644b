"""The version, in one place for all of Python."""

from importlib.metadata import PackageNotFoundError, version

try:
    VERSION = version("ecatd")
except PackageNotFoundError:  # run from a checkout that is not installed
    VERSION = "0+uninstalled"
