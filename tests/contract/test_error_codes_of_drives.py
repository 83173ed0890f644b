"""Error codes of drives: C has those of Python."""

from ecatdev import drive_errors


def test_the_header_has_all_error_codes() -> None:
    command = "PYTHONPATH=tools .venv/bin/python -m ecatdev.drive_errors"
    assert drive_errors.FILE.read_text() == drive_errors.header(), f"run: {command}"
