"""The one layout, seen from C, C++ and Python."""

import subprocess
from pathlib import Path

import pytest

from ecatd import shm

INCLUDE = Path(__file__).parents[2] / "client_c" / "include"

PROGRAM = """
#include <ecat/ecat_shm.h>
#include <stddef.h>
#include <stdio.h>
#define STRUCT(name, comment) \\
  { typedef name self; const char *me = #name; \\
    printf("%s - 0 %u\\n", me, (unsigned)sizeof(self));
#define FIELD(type, field, count, comment) \\
    printf("%s %s %u %u\\n", me, #field, (unsigned)offsetof(self, field), \\
           (unsigned)sizeof(((self *)0)->field));
#define END(name) }
int main(void) {
#include <ecat/ecat_shm.def>
  return 0;
}
"""


@pytest.mark.parametrize(
    ("compiler", "standard", "suffix"),
    [("gcc", "-std=c89", ".c"), ("gcc", "-std=c11", ".c"), ("g++", "-std=c++17", ".cpp")],
)
def test_offsets_and_sizes_agree(tmp_path: Path, compiler: str, standard: str, suffix: str) -> None:
    source = tmp_path / f"layout{suffix}"
    source.write_text(PROGRAM)
    program = tmp_path / "layout"
    subprocess.run(
        [compiler, standard, f"-I{INCLUDE}", "-o", program, source], check=True, text=True
    )
    compiled = subprocess.run([program], check=True, text=True, capture_output=True).stdout
    seen = [tuple(line.split()) for line in compiled.splitlines()]
    described = [
        (struct, field, str(offset), str(size))
        for struct, rows in shm.layout().items()
        for field, _kind, offset, size, _count in rows
    ]
    assert seen == described
    for struct, rows in shm.layout().items():
        for field, _kind, offset, size, _count in rows[1:]:
            place = getattr(shm.struct(struct), field)
            assert (place.offset, place.size) == (offset, size)


def test_fields_leave_no_holes() -> None:
    for struct, rows in shm.layout().items():
        end = 0
        for field, _kind, offset, size, _count in rows[1:]:
            assert offset == end, f"{struct}.{field} is preceded by padding"
            end = offset + size
        assert end == rows[0][3], f"{struct} ends with padding"


@pytest.mark.parametrize("header", ["ecat.h", "ecat_shm.h"])
@pytest.mark.parametrize(
    "command",
    [
        ("gcc", "-std=c89", "-pedantic-errors", "-x", "c"),
        ("g++", "-std=c++17", "-pedantic-errors", "-x", "c++"),
    ],
)
def test_public_headers_are_clean(tmp_path: Path, header: str, command: tuple[str, ...]) -> None:
    source = tmp_path / "use"
    source.write_text(f"#include <ecat/{header}>\nint main(void) {{ return 0; }}\n")
    subprocess.run(
        [*command, "-Wall", "-Wextra", "-Werror", "-fsyntax-only", f"-I{INCLUDE}", source],
        check=True,
    )


def test_constants_of_python_are_those_of_c(tmp_path: Path) -> None:
    source = tmp_path / "constants.c"
    names = "ECAT_SHM_MAGIC ECAT_OUT_MAGIC ECAT_SHM_LAYOUT ECAT_SLOTS ECAT_IMAGES ECAT_REQUESTS"
    prints = "".join(f'printf("%llu ", (unsigned long long){name});' for name in names.split())
    source.write_text(
        f"#include <ecat/ecat_shm.h>\n#include <stdio.h>\nint main(void) {{ {prints} return 0; }}"
    )
    subprocess.run(["gcc", f"-I{INCLUDE}", "-o", tmp_path / "c", source], check=True)
    values = subprocess.run([tmp_path / "c"], check=True, text=True, capture_output=True).stdout
    assert [int(value) for value in values.split()] == [
        shm.SHM_MAGIC,
        shm.OUT_MAGIC,
        shm.LAYOUT,
        shm.SLOTS,
        shm.IMAGES,
        shm.REQUESTS,
    ]
