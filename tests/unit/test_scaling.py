"""Physical values: one formula in each language, with the same numbers to the last bit."""

import ast
import ctypes
import math
import random
import re
from pathlib import Path

import pytest

from ecatd.etg.scaling import formula_text, to_physical, to_physical_each, to_raw
from ecatd.shm.contract import LIBRARY

ROOT = Path(__file__).parents[2]
FORMULA = re.compile(r"\*\s*[\w.>{ -]*scale[ })]*\+|offset[ })]*/\s*[\w.>{ -]*scale\b")
TEXTS = re.compile(r'/\*.*?\*/|"(?:\\.|[^"\\])*"|//[^\n]*', re.DOTALL)
"""Comments and texts of C and Modelica."""
PLACES = {
    "client_c/src/values.c",
    "codegen/ecatgen/modelica/EtherCAT/Drives/Utilities/ToPhysical.mo",
    "codegen/ecatgen/modelica/EtherCAT/Drives/Utilities/ToRaw.mo",
    "daemon/ecatd/etg/scaling.py",
}


def test_c_and_python_make_the_same_numbers() -> None:
    functions = [LIBRARY["ecat_to_physical"], LIBRARY["ecat_to_raw"]]
    for function in functions:
        function.restype = ctypes.c_double
        function.argtypes = [ctypes.c_double] * 3
    physical_in_c, raw_in_c = functions
    source = random.Random(41)
    numbers = [
        (source.choice((0.0, -0.0, 1.0, 32767.0, source.uniform(-1e6, 1e6), 1e308)), scale, offset)
        for scale in (1.0, -1.0, 0.1, 0.000305185, 1e-300, 1e300)
        for offset in (0.0, -273.15, 0.3, 1e300, *(source.uniform(-10, 10) for _ in range(100)))
    ]
    for value, scale, offset in numbers:
        physical, raw = to_physical(value, scale, offset), to_raw(value, scale, offset)
        assert physical.hex() == physical_in_c(value, scale, offset).hex()
        assert raw.hex() == raw_in_c(value, scale, offset).hex()
    each = to_physical_each(*zip(*numbers, strict=True))
    assert [value.hex() for value in each] == [to_physical(*row).hex() for row in numbers]


def test_a_raw_value_comes_back() -> None:
    for raw in (0, 1, -1, 12345, -32768):
        physical = to_physical(raw, -0.25, 4)
        assert math.isclose(to_raw(physical, -0.25, 4), raw)


@pytest.mark.parametrize(
    ("scale", "offset", "text"),
    [
        (1, 0, "raw"),
        (0.5, 0, "raw * 0.5"),
        (1, -4, "raw - 4"),
        (-2, 3, "raw * -2 + 3"),
    ],
)
def test_the_formula_for_people(scale: float, offset: float, text: str) -> None:
    assert formula_text("raw", scale, offset) == text


def test_nobody_else_has_the_formula() -> None:
    found = set()
    for folder in ("daemon", "client_c", "codegen", "simulator"):
        for path in (ROOT / folder).rglob("*"):
            if path.suffix == ".py":
                code = python_code(path.read_text())
            elif path.suffix in (".c", ".h", ".hpp", ".j2", ".mo"):
                code = TEXTS.sub("", path.read_text())
            else:
                continue
            if FORMULA.search(code):
                found.add(str(path.relative_to(ROOT)))
    assert found == PLACES


def python_code(text: str) -> str:
    """Code without comments and texts."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            node.value = ""
    return ast.unparse(tree)
