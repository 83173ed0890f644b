"""Optional slaves that nothing but their order tells apart."""

from pathlib import Path

import pytest

from conftest import names_at
from ecatd.config import load_config
from ecatd.config.resolve import alike_slaves


def row(position: int | None, product: int = 7, more: str = "optional = true") -> str:
    place = "" if position is None else f"position = {position}\n"
    return f"[[slave]]\n{place}vendor = 2\nproduct = {product}\n{more}\n"


def group(*positions: int, name: str, products: tuple[int, ...] = (1, 7)) -> str:
    rows = zip(positions, products, strict=True)
    return "".join(row(n, product, f"group = '{name}'") for n, product in rows)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            row(0) + row(1),
            "7: slave[1].position: slave 0 | slave 1 | side by side | alias | identification",
        ),
        (row(0) + row(1, 8) + row(2), "12: slave[2].position: slave 0 | slave 2 | between"),
        (
            group(0, 1, name="a") + group(2, 3, name="b"),
            "12: slave[2].position: group a | group b",
        ),
        (row(0) + "serial = 5\n" + row(1), "8: slave[1].position: slave 0 | slave 1"),
        (row(0, 9, "") + row(1) + row(2), "12: slave[2].position: slave 1 | slave 2"),
    ],
)
def test_they_are_told(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "ecat0.toml"
    file.write_text(text)
    (told,) = alike_slaves(load_config(file))
    names_at(told.replace(f"{file}:", ""), message)


@pytest.mark.parametrize(
    "text",
    [
        row(0) + row(1, more=""),
        row(0) + row(1, 8, "") + row(2),
        row(0) + row(2),  # any slave that must be there is between them
        row(0) + row(1, 8),
        row(0) + "serial = 5\n" + row(1) + "serial = 6\n",
        row(0) + "revision = 5\n" + row(1) + "revision = 6\n",
        row(None, 7, "alias = 4\noptional = true") + row(None, 7, "alias = 5\noptional = true"),
        group(0, 1, name="a") + group(2, 3, name="b", products=(1, 8)),
        row(0, more="") + row(1, more=""),
    ],
)
def test_others_are_not(tmp_path: Path, text: str) -> None:
    file = tmp_path / "ecat0.toml"
    file.write_text(text)
    assert alike_slaves(load_config(file)) == []
