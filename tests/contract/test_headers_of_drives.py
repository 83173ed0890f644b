"""Headers of the C client that are made from Python: error codes of drives, and units of axes."""

from ecatdev import axis_units, drive_errors


def test_the_header_has_all_error_codes() -> None:
    command = "PYTHONPATH=tools .venv/bin/python -m ecatdev.drive_errors"
    assert drive_errors.FILE.read_text() == drive_errors.header(), f"run: {command}"


def test_the_header_has_the_units_of_axes() -> None:
    command = "PYTHONPATH=tools .venv/bin/python -m ecatdev.axis_units"
    assert axis_units.FILE.read_text() == axis_units.header(), f"run: {command}"
