"""The one definition of the layout, seen from C, C++ and Python."""

import subprocess
from pathlib import Path

import pytest

from ecatd.cli.layout_tables import layout_lines
from ecatd.description.limits import DOMAINS_MAX
from ecatd.shm import contract as shm

INCLUDE = Path(__file__).parents[2] / "client_c" / "include"

# Prints what a compiler makes of the definition, in the words of ecat_layout().
PROGRAM = r"""
#include <ecat/ecat.h>
#include <ecat/ecat_shm.h>
#include <stddef.h>
#include <stdio.h>
int main(void) {
  const char *of = "";
#define ECAT_CONST(name, comment) \
    printf("const - " #name " - %llu - -\n", (unsigned long long)name);
#define ECAT_ENUM(name, comment) of = #name; printf("enum %s - - - - -\n", of);
#define ECAT_FIRST(name, number, comment) printf("value %s " #name " - %d - -\n", of, (int)name);
#define ECAT_VALUE(name, number, comment) printf("value %s " #name " - %d - -\n", of, (int)name);
#include <ecat/ecat_shm.def>
#define ECAT_ENUM(name, comment) of = #name; printf("enum %s - - - - -\n", of);
#define ECAT_FIRST(name, number, comment) printf("value %s " #name " - %d - -\n", of, (int)name);
#define ECAT_VALUE(name, number, comment) printf("value %s " #name " - %d - -\n", of, (int)name);
#include <ecat/ecat.def>
#define ECAT_STRUCT(name, comment) \
  { typedef name self; of = #name; printf("struct %s - - - %u -\n", of, (unsigned)sizeof(self));
#define ECAT_FIELD(type, field, count, comment) \
    printf("field %s " #field " " #type " %u %u %u\n", of, (unsigned)offsetof(self, field), \
           (unsigned)sizeof(((self *)0)->field), \
           (unsigned)(sizeof(((self *)0)->field) / sizeof(type)));
#define ECAT_END(name) }
#include <ecat/ecat_shm.def>
#define ECAT_STRUCT(name, comment) of = #name;
#define ECAT_COUNTER(name, unit, severity, comment) \
    printf("counter %s " #name " " #unit " - - -\n", of);
#include <ecat/ecat_shm.def>
  return 0;
}
"""


@pytest.mark.parametrize(
    ("compiler", "standard", "suffix"),
    [("gcc", "-std=c89", ".c"), ("gcc", "-std=c11", ".c"), ("g++", "-std=c++17", ".cpp")],
)
def test_r27_c_and_cpp_see_what_python_sees(
    tmp_path: Path, compiler: str, standard: str, suffix: str
) -> None:
    source = tmp_path / f"layout{suffix}"
    source.write_text(PROGRAM)
    program = tmp_path / "layout"
    subprocess.run(
        [compiler, standard, f"-I{INCLUDE}", "-o", program, source], check=True, text=True
    )
    compiled = subprocess.run([program], check=True, text=True, capture_output=True).stdout
    described = shm.LIBRARY.ecat_layout().decode().splitlines()
    assert compiled.splitlines() == [" ".join(line.split(" ")[:7]) for line in described]


def test_r27_python_makes_the_same_structs() -> None:
    structs = [line.of for line in shm.DEFINITION if line.kind == "struct"]
    assert len(structs) == len(set(structs)) > 15
    for name in structs:
        made = shm.struct(name)
        for field in shm.fields_of(name):
            place = getattr(made, field.name)
            assert (place.offset, place.size) == (field.value, field.size)


def test_r27_fields_leave_no_holes() -> None:
    for struct in (line for line in shm.DEFINITION if line.kind == "struct"):
        end = 0
        for field in shm.fields_of(struct.of):
            assert field.value == end, f"{struct.of}.{field.name} is preceded by padding"
            end = field.value + field.size
        assert end == struct.size, f"{struct.of} ends with padding"
        assert end % 4 == 0


def common_prefix(names: list[str]) -> str:
    """The words that all names begin with: `ECAT_BUS_`."""
    first, last = min(names).split("_"), max(names).split("_")
    same = [a for a, b in zip(first, last, strict=False) if a == b]
    return "_".join([*same, ""])


def test_enumerations_of_python_are_those_of_c() -> None:
    defined = {line.of for line in shm.DEFINITION if line.kind == "enum"}
    assert defined == set(shm.ENUMS)
    for name, members in shm.ENUMS.items():
        values = {v.name: v.value for v in shm.DEFINITION if v.kind == "value" and v.of == name}
        prefix = common_prefix(list(values))
        short = {key.removeprefix(prefix): value for key, value in values.items()}
        assert {member.name: member.value for member in members} == short, name


def test_what_a_later_version_adds_to_an_enumeration_is_a_member() -> None:
    later = shm.Reason(99)
    assert (later, later.name) == (99, "UNKNOWN_99")
    assert later not in list(shm.Reason)
    assert shm.Reason.named("unknown_99") == later
    assert shm.Reason.named("lapsed") is shm.Reason.LAPSED
    with pytest.raises(KeyError):
        shm.Reason.named("unknown_x")
    with pytest.raises(ValueError, match="is not a valid"):
        shm.Reason("99")


def test_other_limits_are_the_same() -> None:
    assert DOMAINS_MAX == shm.MAX_DOMAINS
    assert len(shm.Setting) == shm.SETTINGS
    for name in ("ecat_shm_reply", "ecat_out_request"):
        assert shm.struct(name).data.size == shm.REQUEST_BYTES
    assert bytes(shm.SHM_MAGIC.to_bytes(8, "little")) == b"ECATSHM1"
    assert bytes(shm.OUT_MAGIC.to_bytes(8, "little")) == b"ECATOUT1"


def test_every_error_code_has_its_text() -> None:
    shm.LIBRARY.ecat_strerror.restype = shm.ctypes.c_char_p
    texts = {v.value: v.comment for v in shm.DEFINITION if v.of == "ecat_errno"}
    for code in shm.Errno:
        assert shm.LIBRARY.ecat_strerror(int(code)).decode() == texts[code]
    assert shm.LIBRARY.ecat_strerror(-99) == b"unknown error"
    assert shm.LIBRARY.ecat_strerror(7) == b"no error"


def test_the_page_of_the_layout_is_up_to_date() -> None:
    text = (INCLUDE.parents[1] / "docs" / "shared-memory.md").read_text()
    tables = text.split("<!-- layout -->\n\n")[1].split("\n\n<!-- /layout -->")[0]
    assert tables.splitlines() == layout_lines(), "put the output of `ecatctl shm --layout` there"


def test_fields_have_their_enumerations() -> None:
    kinds = {field.name: shm.enumeration(field) for field in shm.fields_of("ecat_shm_health")}
    found = {name: kind for name, kind in kinds.items() if kind is not None}
    links = {"link_first": shm.Link, "link_second": shm.Link}
    assert found == {"ring": shm.Ring, **links, "dc_state": shm.DcState}
