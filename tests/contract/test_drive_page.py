"""docs/drive-profiles.md is up to date."""

from ecatdev.drive_page import PAGE, page


def test_the_page_says_what_the_files_say():
    assert PAGE.read_text() == page(), "PYTHONPATH=tools .venv/bin/python -m ecatdev.drive_page"
