"""Hostile texts in every text of a bus: what is generated has the same shape as for harmless ones.

A name that gets out of its string, comment or line changes the tokens around it. So the generated
files are compared with those of a bus with harmless texts, after strings, comments and names were
replaced; and compilers and parsers take them.
"""

import ast
import json
import re
import subprocess
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import fmpy
import pytest
from pymoca.parser import parse

import ecatgen
from conftest import naming
from ecatd.base.errors import ConfigError, UsageError
from ecatd.cli.graph_svg import svg_text
from ecatd.cli.slave_tree import Node
from ecatd.config import Config
from ecatd.config.writer import Notes, write_config
from ecatd.description import bus_file
from ecatd.description.bus import Bus, Domain, Module, Slave
from ecatd.description.bus_reader import read_bus
from ecatd.etg.pdo import Pdo, Value
from ecatd.master.engine.process_image import lay_out
from ecatd.vendor.esi.writer import bus_document
from ecatdev import sample_buses
from ecatgen import generate
from ecatgen.build import build_library
from ecatgen.c_structs import c_structs
from ecatgen.fmu.build import build_fmu
from ecatgen.fmu.generate import generate_fmu
from ecatgen.fmu.render import render as render_fmu
from ecatgen.render import render

HOSTILE = [
    '"; end Plant; model Evil Real x; end Evil; package More "',
    'Q", start = x) "x"; annotation(Library="pwn"); Real injected(quantity="Q',
    "x */ __attribute__((constructor)) static void pwn(void) {} /*",
    '\\"',
    "ends with \\",
    "/*/ ??/ ???> %s %n '",
    "\n#error injected\nvariable Real input x x",
    "\r\n[[slave]]\rposition = x",
    "${HOME} $(reboot) `reboot` {{ x * x }} {% raw %} {# #}",
    "]]> --> <!-- <script>alert(x)</script> </html> &amp; &#x;",
    "\0\x01\x1b]0;title\x07\x1b[m\x7f\x9b\x85",
    "\u202egnol\u202c \u2066a\u2069 \u2028 \u2029 \ufeff \ufffe \uffff \U000e0001",
    "\ud800 lone",
    "long " * 800,
]
ALL = "".join(HOSTILE[:-1])
HARMLESS = "harmless text"  # no name of a block either


def _with(value: Any, text: str) -> Any:
    """The same with this text in place of every text, but the name of the bus."""
    if isinstance(value, str):
        return text
    if isinstance(value, list):
        return [_with(item, text) for item in value]
    if is_dataclass(value) and not isinstance(value, type):
        found = {item.name: _with(getattr(value, item.name), text) for item in fields(value)}
        if isinstance(value, Bus):
            found["name"] = value.name
        return type(value)(**found)
    return value


def bus_of(text: str) -> Bus:
    """A bus with a drive, terminals and a module, whose texts are all this one."""
    bus = sample_buses.troll()
    bus.slaves = [bus.slaves[position] for position in (0, 1, 3, 4)]
    for position, slave in enumerate(bus.slaves):
        slave.position = position
    bus.domains = [Domain("base"), Domain("slow", 2)]
    bus.slaves[0].problems, bus.slaves[0].profiles = ["one"], ["one", "two"]
    bus.slaves[0].modules = [Module(1, "one")]
    for slave in bus.slaves:
        for _, entry, _ in (*slave.entries(outputs=True), *slave.entries(outputs=False)):
            entry.values = [Value(0, "off")]
    made: Bus = _with(bus, text)
    for slave in made.slaves:  # a name of the configuration that is hostile is refused: see below
        slave.given_name = "" if slave.position else "Größe-x"
    lay_out(made, set())
    return made


class _Elements(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[object] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, [name for name, _ in attrs]))

    def handle_endtag(self, tag: str) -> None:
        self.found.append(tag)


def elements(text: str) -> list[object]:
    parser = _Elements()
    parser.feed(text)
    return parser.found


_POINTS = re.compile(r"\{-?\d+, -?\d+\}(?:, \{-?\d+, -?\d+\})*")
_TOKEN = re.compile(
    r'(?P<string>"(?:[^"\\]|\\.)*")|(?P<comment>/\*.*?\*/)|(?P<name>[A-Za-z_]\w*)|(?P<number>-?\d[\d.]*)|\s+|.',
    re.DOTALL,
)


def shape(path: str, text: str) -> list[object]:
    """The kinds of all tokens, and the elements of HTML in strings.

    The length of a name decides where lines and boxes are, so points of a drawing are left out.
    """
    if path.endswith((".xml", ".svg")):
        return sorted((e.tag, sorted(e.attrib)) for e in ElementTree.fromstring(text).iter())
    if path.endswith(".html"):
        return elements(text)
    if path.endswith(".txt"):
        lines = text.split("\n")
        return [(line.split(" ")[0], len(line.splitlines())) for line in lines]
    if path.endswith(".order"):
        return [len(line.split()) for line in text.split("\n")]
    found: list[object] = []
    for match in _TOKEN.finditer(_POINTS.sub("", text)):
        if match["string"] and "<html>" in match["string"]:
            found.append(elements(match["string"].replace('\\"', '"')))
        elif match["string"] or match["comment"] or match["name"] or match["number"]:
            found.append(match.lastgroup)
        elif not match[0].isspace():
            found.append(match[0])
    return found


def node(slave: Slave) -> Node:
    known = {item.name: None for item in fields(Node)}
    return Node(
        **known
        | {"position": slave.position, "name": slave.display_name, "state": "OP", "behind": []}
        | {"loose": [], "errors": None}
    )


def generated(bus: Bus) -> dict[str, str]:
    """Every kind of file that is made of a description, by a path that says its language."""
    library = build_library(bus, "Plant")
    files = {path: data.decode() for path, data in render(library).items()}
    for fmi in (2, 3):
        fmu = build_fmu(bus, library, fmi, ["plant.c"])
        files |= {f"{fmi}/{path}": data.decode() for path, data in render_fmu(fmu).items()}
    files["image.h"] = c_structs(bus, "1")
    files["bus.xml"] = bus_document(bus, "1")
    return files


def shapes(bus: Bus) -> list[tuple[bool, list[object]]]:
    return [(path.endswith(".mo"), shape(path, text)) for path, text in generated(bus).items()]


@pytest.fixture(scope="module")
def expected() -> list[tuple[bool, list[object]]]:
    return shapes(bus_of(HARMLESS))


@pytest.mark.parametrize(
    "text", [ALL, HOSTILE[0], HOSTILE[4], HOSTILE[-1]], ids=["all", "quote", "backslash", "long"]
)
def test_hostile_texts_do_not_change_the_shape_of_what_is_generated(
    text: str, expected: list[tuple[bool, list[object]]]
) -> None:
    found = shapes(bus_of(text))
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        assert one == other


def classes(parsed: Any) -> Iterator[str]:
    """All classes in a parsed file, but those of the language."""
    for name, inner in parsed.classes.items():
        if name not in ("Real", "Integer", "Boolean", "String", "StateSelect", "Clock"):
            yield name
            yield from classes(inner)


def test_hostile_texts_give_what_compilers_and_parsers_take(tmp_path: Path, compiler: str) -> None:
    bus = bus_of(ALL)
    generate(bus, "Plant", tmp_path)
    for file in (tmp_path / "Plant").rglob("*.mo"):
        wanted = set(file.relative_to(tmp_path).with_suffix("").parts) - {"package"}
        assert set(classes(parse(file.read_text("utf-8")))) == wanted
    resources = tmp_path / "EtherCAT" / "Resources"
    (tmp_path / "image.h").write_text(c_structs(bus, "1"))
    for standard, file in (
        ("-std=c89", tmp_path / "Plant" / "Resources" / "Source" / "Plant.h"),
        ("-std=gnu11", tmp_path / "image.h"),
    ):
        done = subprocess.run(
            [
                *(compiler, standard, "-Wall", "-Wextra", "-Werror", "-Wtrigraphs"),
                *(("-pedantic-errors",) if standard == "-std=c89" else ()),
                *("-I", str(resources / "Include")),
                *("-I", str(resources / "Source" / "standalone")),
                *("-fsyntax-only", "-x", "c", str(file)),
            ],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
    for fmi in (2, 3):
        generate_fmu(bus, f"Plant{fmi}", tmp_path, fmi)
        fmpy.read_model_description(str(tmp_path / f"Plant{fmi}.fmu"), validate=True)


def test_a_configuration_of_hostile_texts_is_toml() -> None:
    for text in [*HOSTILE, ALL]:
        bus = bus_of(text)
        notes = Notes(top=[text], slaves={0: [text]}, pdos={0: [text]}, clocks={0: [text]})
        made = tomllib.loads(write_config(Config(), bus, "1", notes))
        assert len(made["slave"]) == len(bus.slaves)
        assert {row["position"] for row in made["slave"]} == set(range(len(bus.slaves)))


def places(text: str) -> Iterator[tuple[str, Callable[[Bus], None]]]:
    """Each place of a description that has a rule, and what puts the text there."""

    def entry(key: str) -> Callable[[Bus], None]:
        return lambda bus: setattr(bus.slaves[0].inputs[0].entries[0], key, text)

    yield from (
        (f"slaves[0].inputs[0].entries[0].{key}", entry(key))
        for key in ("quantity", "display_unit", "unit")
    )
    yield "slaves[0].given_name", lambda bus: setattr(bus.slaves[0], "given_name", text)
    yield "slaves[0].group", lambda bus: setattr(bus.slaves[0], "group", text)
    yield "domains[0].name", lambda bus: setattr(bus, "domains", [Domain(text)])
    yield (
        "slaves[0].modules[0].name",
        lambda bus: setattr(bus.slaves[0], "modules", [Module(1, text)]),
    )


def test_names_that_cannot_be_are_refused_when_a_description_is_read() -> None:
    for text in HOSTILE:
        for place, put in places(text):
            if place.endswith(("domains[0].name", "modules[0].name", ".unit")):
                continue  # these may have any letters: see the next test
            bus = sample_buses.axes()
            put(bus)
            saved = bus_file.dump(bus)
            with pytest.raises(UsageError, match=naming(place)):
                bus_file.parse(saved, "evil.json")
            with pytest.raises(UsageError, match=naming(place)):  # what a gateway answers
                read_bus(json.loads(saved), "the daemon", strict=False)


def test_names_for_people_are_one_printable_line() -> None:
    for place, put in places("two\nlines"):
        bus = sample_buses.troll()
        put(bus)
        with pytest.raises(UsageError, match=naming(place)):
            bus_file.parse(bus_file.dump(bus), "evil.json")


@pytest.mark.parametrize(
    ("name", "template", "told"),
    [
        ("block.mo.j2", "\n{{ block.slave_name }}", ":2: 'harmless text'"),
        ("block.mo.j2", "{{ 'a' ~ block.slave_name }}", ":1: 'aharmless text'"),
        ("block.mo.j2", "{{ 'a' + block.slave_name }}", ":1: 'aharmless text'"),
        ("block.mo.j2", "{{ '%s' % block.slave_name }}", ":1: 'harmless text'"),
        ("block.mo.j2", "{{ '{}'.format(block.slave_name) }}", ":1: 'harmless text'"),
        ("block.mo.j2", "{{ [block.slave_name] | join('x') }}", ":1: 'harmless text'"),
        ("block.mo.j2", "{{ block.slave_name | safe }}", ":1: "),
        ("block.mo.j2", "{{ block.slave_name | string | upper }}", ":1: "),
        ("block.mo.j2", "{{ block.slave_name | string | replace('h', '\"') }}", ":1: "),
        ("block.mo.j2", "{{ block.slave_name | c_comment }}", ":1: "),
        ("block.mo.j2", "{{ block.slave_name | identifier ~ ';' }}", ":1: "),
        ("block.mo.j2", "{% set x %}{{ block.slave_name }}{% endset %}{{ x }}", ":1: "),
        ("block.mo.j2", "{% macro m(x) %}{{ x }}{% endmacro %}\n{{ m(block.title) }}", ":1: "),
        ("block.mo.j2", "{% filter replace('x', block.title) %}x{% endfilter %}", ":1: "),
        ("block.mo.j2", "{{ block }}", ":1: "),
        ("block.mo.j2", "{{ none }}", ":1: "),
        ("block.mo.j2", "{{ block.coupler }}", ":1: "),
        ("block_info.html.j2", "{{ block.title | string }}", ":1: "),
        ("calls.h.j2", "{{ library.command | html }}", ":1: "),
        ("package.order.j2", "{{ library.command | string }}", ":1: "),
    ],
)
def test_a_template_cannot_write_plain_text(
    tmp_path: Path, name: str, template: str, told: str
) -> None:
    (tmp_path / name).write_text(template)
    library = build_library(bus_of(HARMLESS), "Plant")
    with pytest.raises(ConfigError) as error:
        render(library, [tmp_path])
    assert f"{tmp_path / name}{told}" in str(error.value)


def test_what_a_template_may_write(tmp_path: Path) -> None:
    (tmp_path / "block.mo.j2").write_text(
        "{% macro m(x) %}{{ x | string }}!{% endmacro %}"
        "{% set y %}{{ block.title | html }}{% endset %}"
        "{{ m('a\"') }} {{ y }} {{ '%04X %s' % (block.vendor, block.name) }} "
        "{{ 'yes' if block.reads else 'no' }} {{ [block.name, 1, 0.5] | join('; ') }} "
        "{{ (block.name ~ block.title) | c_comment | length }} {{ block.icon }}\n"
    )
    library = build_library(bus_of(HARMLESS), "Plant")
    made = render(library, [tmp_path])["HarmlessText.mo"].decode()
    assert made.startswith(
        '"a\\""! HarmlessText, slave 1 0002 HarmlessText no HarmlessText; 1; 0.5 '
    )
    assert re.search(r" \d+ \{\{-?\d+, -?\d+\}, \{100, 100\}\}\n$", made)


def test_a_picture_of_hostile_texts_is_xml() -> None:
    for text in [*HOSTILE, ALL]:
        slave = replace(bus_of(HARMLESS).slaves[0], name=text, inputs=[Pdo(1, text, 3)])
        assert ElementTree.fromstring(svg_text(text, [node(slave)])).tag.endswith("svg")


def test_only_one_module_vouches_for_texts_that_are_no_literals() -> None:
    folder = Path(ecatgen.__file__).parent
    calls = 0
    for file in folder.rglob("*.py"):
        for call in ast.walk(ast.parse(file.read_text("utf-8"))):
            if not isinstance(call, ast.Call) or getattr(call.func, "id", "") != "Code":
                continue
            if file != folder / "text.py":
                calls += 1
                (text,) = call.args
                chosen = [text.body, text.orelse] if isinstance(text, ast.IfExp) else [text]
                assert all(isinstance(item, ast.Constant) for item in chosen), (file, call.lineno)
    assert calls > 50
