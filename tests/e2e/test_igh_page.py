"""docs/from-igh.md names a command of ours, or a reason, for each of IgH's."""

from pathlib import Path

from ecatd.cli.commands import find_commands
from ecatdev.igh_page import ROWS, shown, table

PAGE = Path(__file__).parents[2] / "docs" / "from-igh.md"


def test_all_34_commands_have_an_answer() -> None:
    assert len({row.igh for row in ROWS}) == 34
    known = {found.name for found in find_commands()} | {"--version"}
    assert {row.ours.split()[0] for row in ROWS if row.ours} <= known
    assert all(row.ours or row.remark for row in ROWS)


def test_the_page_is_that_of_the_tool() -> None:
    text = PAGE.read_text()
    assert table() in text
    assert all(f"$ ecatctl {row.run}\n" in text for row in ROWS if row.run)


def test_what_is_cut_has_a_mark() -> None:
    whole = "x" * 110
    assert shown(f"{whole}\n{whole}y\n") == f"{whole}\n{whole[:-1]}…"
    assert shown(13 * "a\n") == 12 * "a\n" + "..."
