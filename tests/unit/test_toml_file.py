"""Reading TOML: where messages say that something is, and what they say of it."""

import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from conftest import names, names_at, naming
from ecatd.base.errors import ConfigError, UsageError
from ecatd.base.toml_file import Document, Table, integer, number, parse_toml, read_toml
from ecatd.base.toml_places import Path as KeyPath
from ecatd.base.toml_places import find_places

TEXT = '''\
# [not.a.table]
name = "x"  # comment with a ] and a "
"quoted \\u0061" = 1
'literal key' = 2
site.hall . 'row 3' = 0x1F
text = """
[table]
key = 1
""" # and more
plain = \'\'\'
[[list]]
\'\'\'
numbers = [
  1, # one ]
  0x2,
  [ 3, 4 ],
  { five = 5, six.seven = [
    8 ] },
]
inline = { a = 1, b = { c = "}" }, d = [1, 2] }

[tool]
speed = 1_000
[tool.head.left]
"speed" = 1e3
[[part]]
size = 1
[[part.hole]]
x = 1
[[part.hole]]
x = 2
[part.hole.edge]
kind = 'round'
[[part]]
[[part.hole]]
x = 3
[deep]
[[ deep . list ]]
date = 1979-05-27T07:32:00Z
'''


def paths(value: Any, path: KeyPath = ()) -> list[KeyPath]:
    """The path of everything in a document."""
    items: Any = ()
    if isinstance(value, dict | list):
        items = value.items() if isinstance(value, dict) else enumerate(value)
    inner = [found for key, item in items for found in paths(item, (*path, key))]
    return [path, *inner] if path else inner


def test_everything_has_its_line() -> None:
    places = find_places(TEXT)
    assert set(places) == set(paths(tomllib.loads(TEXT)))
    lines = {path: place.line for path, place in places.items()}
    rows = TEXT.splitlines()
    for path, part in (
        (("name",), "name ="),
        (("quoted a",), '"quoted'),
        (("literal key",), "'literal"),
        (("site", "hall", "row 3"), "site."),
        (("text",), "text ="),
        (("plain",), "plain ="),
        (("numbers",), "numbers ="),
        (("numbers", 0), "  1,"),
        (("numbers", 1), "  0x2"),
        (("numbers", 2, 1), "  [ 3"),
        (("numbers", 3, "five"), "  { five"),
        (("numbers", 3, "six", "seven"), "  { five"),
        (("numbers", 3, "six", "seven", 0), "    8 ]"),
        (("inline", "b", "c"), "inline"),
        (("inline", "d", 1), "inline"),
        (("tool", "speed"), "speed = 1_"),
        (("tool", "head"), "[tool.head"),
        (("tool", "head", "left", "speed"), '"speed'),
        (("part", 0, "size"), "size"),
        (("part", 0, "hole", 0, "x"), "x = 1"),
        (("part", 0, "hole", 1, "x"), "x = 2"),
        (("part", 0, "hole", 1, "edge", "kind"), "kind"),
        (("part", 1, "hole", 0, "x"), "x = 3"),
        (("deep", "list", 0, "date"), "date"),
    ):
        assert rows[lines[path] - 1].startswith(part), path
    assert [lines["part", n] for n in (0, 1)] == [rows.index("[[part]]") + 1, 34]
    assert places["site", "hall", "row 3"].value == "0x1F"
    assert places["tool", "speed"].value == "1_000"
    assert places["numbers", 1].value == "0x2"


# TOML in every way of writing it.

BLANKS = st.sampled_from(["", "\n", "# a [comment] = 'of\" ours\n", "  \n\n"])
SPACES = st.sampled_from(["", " ", "\t"])
BARE = ("a", "b", "c-1", "_", "7")
NAMES = st.sampled_from(BARE) | st.text('ab "\\#=[]{},.é', max_size=4)
SIMPLE = (
    *("1", "0x1F", "-1e3", "inf", "true", "1979-05-27", "07:32:00", '"]"', "'}'", '""', '"\\""'),
    *("'''\n[a]\n'b'''''", '"""\n\\"""\n[[b]]\n\\\\"""', "''''''", '"""a""\\\n b""""'),
)


@st.composite
def keys(draw: st.DrawFn) -> str:
    name = draw(NAMES)
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    ways = [f"'{name}'", f'"{escaped}"']
    return draw(st.sampled_from([*ways, name] if name in BARE else ways))


@st.composite
def values(draw: st.DrawFn, depth: int = 2) -> str:
    kind = draw(st.integers(0, 3)) if depth else 0
    if kind == 2:
        items = draw(st.lists(values(depth - 1), max_size=3))
        inner = ",".join(f"{draw(BLANKS | SPACES)}{item}{draw(BLANKS)}" for item in items)
        return f"[{inner}{draw(st.sampled_from(['', ','])) if items else ''}{draw(BLANKS)}]"
    if kind == 3:
        names = draw(st.lists(keys(), max_size=3))
        pairs = [f"{name}{draw(SPACES)}={draw(SPACES)}{draw(values(depth - 1))}" for name in names]
        return f"{{{draw(SPACES)}{', '.join(pairs)}{draw(SPACES)}}}"
    return draw(st.sampled_from(SIMPLE))


@st.composite
def statements(draw: st.DrawFn) -> str:
    gap = draw(SPACES)
    key = f"{gap}.{gap}".join(draw(st.lists(keys(), min_size=1, max_size=3)))
    ways = [f"[{gap}{key}{gap}]", f"[[{key} ]]", f"{gap}{key}{gap}={gap}{draw(values())}"]
    return draw(st.sampled_from(ways))


@given(st.lists(st.tuples(BLANKS, statements()), max_size=8))
def test_every_key_of_any_document_has_the_line_of_its_statement(
    parts: list[tuple[str, str]],
) -> None:
    text = ""
    lines: dict[KeyPath, range] = {}
    for blank, statement in parts:
        longer = f"{text}{blank}\n{statement} # end\n"
        try:
            data = tomllib.loads(longer)
        except tomllib.TOMLDecodeError:
            continue  # one that does not go with those before
        first = f"{text}{blank}\n".count("\n") + 1
        here = range(first, first + statement.count("\n") + 1)
        lines |= {path: here for path in paths(data) if path not in lines}
        text = longer
    places = find_places(text)
    assert set(places) == set(lines)
    assert [path for path, line in lines.items() if places[path].line not in line] == []
    for path, place in places.items():
        if place.value:
            value: Any = tomllib.loads(text)
            for key in path:
                value = value[key]
            assert tomllib.loads(f"x = {place.value}") == {"x": value}


# What is said.

RULES = {
    "name": Table.text,
    "count": integer(1, 0xFFFF),
    "share": number(0.1, 1),
    "free": number(),
    "least": number(low=2),
    "on": Table.boolean,
    "place": Table.address,
    "way": lambda table, key: table.choice(key, {"in": 1, "out": 2}),
    "ways": lambda table, key: table.choices(key, {"in": 1, "out": 2}),
    "list": lambda table, key: table.array(key, integer(0, 9)),
    "inner": lambda table, key: table.table(key).read(RULES),
    "part": lambda table, key: [part.read(RULES, ["name"]) for part in table.tables(key)],
}


def read(text: str) -> dict[str, Any]:
    return parse_toml(text, "x.toml").read(RULES)


def test_values() -> None:
    assert read(
        'name = "n"\ncount = 3\nshare = 1\nfree = -1e300\nleast = 2.5\non = true\n'
        'place = "0x1A:f"\nway = "out"\nways = ["out", "in"]\nlist = [0, 9]\n'
        'inner = { name = "i", inner.count = 7 }\n[[part]]\nname = "p"\n[[part.part]]\nname = "q"'
    ) == {
        "name": "n",
        "count": 3,
        "share": 1.0,
        "free": -1e300,
        "least": 2.5,
        "on": True,
        "place": (0x1A, 15),
        "way": 2,
        "ways": [2, 1],
        "list": [0, 9],
        "inner": {"name": "i", "inner": {"count": 7}},
        "part": [{"name": "p", "part": [{"name": "q"}]}],
    }
    assert read("") == {}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nam = 1", "1: nam: 'name'"),
        ("inner.on = 1", "1: inner.on: true | false | 1"),
        ("name = 0x1000", "1: name: text | 0x1000"),
        ("name = 1979-05-27", "1: name: text | 1979-05-27"),
        ("name = []", "1: name: text | an array"),
        ("count = true", "1: count: whole number | true"),
        ("share = 2", "1: share: 2 | 0.1 | 1"),
        ("share = nan", "1: share: finite | nan"),
        (f"free = {10**400}", "1: free: 1329 bits"),
        ("free = '1'", "1: free: number | '1'"),
        ("least = 1", "1: least: 1 | 2"),
        ("place = '6000'", "1: place: \"0x6000:01\" | '6000'"),
        ("way = 1", '1: way: "in" | "out" | 1'),
        ("ways = 'in'", '1: ways: list | "in" | "out" | \'in\''),
        ("ways = [\n'in',\n'up']", '3: ways[1]: \'up\' | "in" | "out"'),
        ("list = 1", "1: list: array | 1"),
        ("list = [\n# none\n10]", "3: list[0]: 10 | 0 | 9"),
        ("[part]", "1: part: [[part]] | table"),
        ("[[part]]", "1: part[0].name: missing | text"),
        (
            "[[part]]\nname = 'a'\n[[part.part]]\nname = 'b'\n[[part]]\nname = 'c'\n"
            "[[part.part]]\nname = 'd'\n[[part.part]]\nname = 'e'\ncount = 0",
            "11: part[1].part[1].count: 0 | 1 | 65535",
        ),
        (
            "part = [\n{ name = 'a', part = [ { name = 'b' },\n{ name = 'c', on = 5 } ] } ]",
            "3: part[0].part[1].on: true | false | 5",
        ),
        (
            'name = """\n[inner]\non = 2\n"""\n[inner]\non = 3',
            "6: inner.on: true | false | 3",
        ),
        (
            "[[part]]\nname = 'a'\npart = [ { name = 'b' }, 5 ]",
            "3: part[0].part[1]: [[part.part]] | 5",
        ),
    ],
)
def test_mistakes(text: str, message: str) -> None:
    with pytest.raises(ConfigError) as error:
        read(text)
    names_at(error.value, f"x.toml:{message}")


def test_keys_in_the_wrong_table() -> None:
    rules = {"speed": integer(0, 9), "axis": Table.table, "row": Table.tables}
    for text, hint in (
        ("[axis]\nspeed = 3", "[table]"),
        ("[axis.axis]", "[axis]"),
        ("[[axis.row]]", "[[row]]"),
    ):
        axis = parse_toml(text, "x").read(rules)["axis"]
        with pytest.raises(ConfigError, match=naming("not a key", hint)):
            axis.only(["name"])


def test_maps_have_no_lines_and_none_is_nothing() -> None:
    table = Table(Document("the map"), {"name": None, "count": 0, "inner": {"on": None}})
    assert "name" not in table
    assert table.table("inner").read(RULES) == {}
    with pytest.raises(ConfigError, match=naming("the map: count:", 0, 1, 65535)):
        table.read(RULES)


def test_mistakes_that_functions_find() -> None:
    def wrong() -> None:
        raise UsageError("is odd")

    def elsewhere() -> None:
        raise ConfigError("y.toml:3: is odd")

    table = parse_toml("name = 3", "x.toml")
    with pytest.raises(ConfigError, match=r"^x\.toml:1: name: is odd$"):
        table.explain("name", wrong)
    with pytest.raises(ConfigError, match=r"^y\.toml:3: is odd$"):
        table.explain("name", elsewhere)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"a = 1\nb =", "2: TOML | Invalid value"),
        (b"a = 1\nb = 2 3\n", "2: TOML | newline"),
        (b"a = 1\r\na = 2\r\n", "2: TOML | overwrite"),
        (b'a = 1\n[b]\nc = "\x00"', "3: TOML | '\\x00'"),
        (b"a = 1\nb = " + b"7" * 5000, "2: digits"),
        (b"a = " + b"[" * 5000, " nested"),
        (b"a = 1\nb = '\xe4'", "2: UTF-8 | continuation byte"),
    ],
    ids=["end", "newline", "twice", "nul", "digits", "depth", "latin-1"],
)
def test_files_that_are_no_toml(tmp_path: Path, data: bytes, message: str) -> None:
    file = tmp_path / "x.toml"
    file.write_bytes(data)
    with pytest.raises(ConfigError) as error:
        read_toml(file)
    line, _, tokens = message.partition(" ")
    assert str(error.value).startswith(f"{file}:{line}")
    names(error.value, *tokens.split(" | "))
    assert "\n" not in str(error.value)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    for name, reason in (
        ("none", "No such file"),
        ("a\0b", "null"),
        (".", "Is a directory"),
        ("/dev/zero", "regular file"),
    ):
        with pytest.raises(ConfigError, match=naming("cannot be read", reason)):
            read_toml(tmp_path / name)
    with (tmp_path / "large").open("wb") as large:
        large.truncate(1 << 27)
    with pytest.raises(ConfigError, match=naming(tmp_path / "large", 134217728, 67108864)):
        read_toml(tmp_path / "large")
