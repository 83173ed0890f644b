"""Valid configurations made of all keys, with one mistake: each is refused in one sentence.

The reader itself says which keys there are, so a new key fails here until it has values below.
"""

import re
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

import pytest
from mutations import inputs

from ecatd.base.errors import ConfigError
from ecatd.base.log_levels import PARTS
from ecatd.config import load_config

pytestmark = pytest.mark.long

REMEDY = re.compile(
    r"did you mean|the keys here are|must (be|have)|belongs (in front|before)|needs|is for|"
    r"allowed|at most|at least|there are|stands in place|is not valid TOML|"
    r"(?<!\w)(write|add|leave|remove|correct|choose|put|use)(?!\w)"
)
"""What a message says about what to do: a verb, or what is allowed."""

SLAVES = ["0", "1", '"press"', '"lamp"']
ENTRIES = ['"0x6000:01"', '"0x60FF:00"', '"0x7010:02"']
VALUES: dict[str, dict[str, list[str]]] = {
    "": {
        "bus": ['"ecat0"', "'rig-1'"],
        "interface": ['"eth1"', '""'],
        "second_interface": ['"eth2"'],
        "cycle_time_us": ["1000", "0x3E8"],
        "state_timeout_s": ["0.1", "300", "3.5"],
        "audit_file": ['""', '"/var/log/ecatd/x"'],
        "profiles": ["[]", '["/here", "there"]'],
    },
    "[log]": {"level": ['"error"', '"debug"'], **{part: ['"debug"'] for part in PARTS}},
    "[flight_recorder]": {
        "memory_mb": ["1", "1024"],
        "folder": ['""', '"/var/lib/x"'],
        "disk_mb": ["1"],
    },
    "[eoe]": {"interface": ['"eoe0"'], "address": ['""']},
    "[expected]": {
        "policy": ['"strict"', '"tolerant"'],
        "unlisted": ["true", "false"],
        "description": ['""', '"bus.json"'],
    },
    "[[slave]]": {
        "position": ["0"],
        "name": ['"press"'],
        "type": ['"EL2008"', '""'],
        "vendor": ["2", "0x00000002"],
        "product": ["0x07D83052"],
        "revision": ["0x00100000"],
        "revision_min": ["0", "4_294_967_295"],
        "serial": ["17"],
        "alias": ["1", "65535"],
        "identification": ["42"],
        "identification_register": ["0x1000"],
        "policy": ['"strict"', '"tolerant"'],
        "optional": ["true"],
        "group": ['"tool"'],
        "watchdog_ms": ["0", "0.1", "6553.5"],
        "pdi_watchdog_ms": ["100"],
        "mailbox_timeout_ms": ["10", "9000"],
        "mailbox_tries": ["1", "10"],
        "mailbox_poll_ms": ["0", "10", "60_000"],
        "pdos": ['["0x1600", 0x1A00]'],
        "pdo_source": ['"coe"', '"sii"', '"soe"'],
    },
    "[[slave.module]]": {
        "slot": ["1", "2", "254"],
        "ident": ["0x108", "1"],
        "type": ['"DI8"'],
    },
    "[[slave.pdo]]": {
        "index": ['"0x1600"', "0x1A00"],
        "entries": ["[]", "[{ object = '0x6040:00', bits = 16 }, { bits = 8 }]"],
    },
    "[[slave.startup]]": {
        "object": ['"0x6065:00"', '"0x1C32:01"'],
        "type": ['"uint32"', '"real32"', '"int64"'],
        "value": ["5", '"7"'],
        "unit": ['"rad/s"'],
        "hex": ['"D2 04"'],
        "complete": ["false"],
        "transition": ['"IP"', '"PS"', '"SO"', '"OS"', '"SP"'],
        "optional": ["true", "false"],
        "comment": ['"why"'],
    },
    "[[slave.idn]]": {
        "idn": ['"S-0-0047"', '"P-0-0010"'],
        "value": ["100", "-2.5", '"S-0-0051, S-0-0040"'],
        "hex": ['"64 00"'],
        "drive": ["0", "7"],
        "transition": ['"IP"', '"PS"', '"SO"'],
        "optional": ["true"],
        "comment": ['"why"'],
    },
    "[slave.eoe]": {
        "mac": ['"02:00:00:00:00:01"'],
        "address": ['"192.168.7.2/24"'],
        "gateway": ['"192.168.7.1"', '""'],
        "dns": ['"10.0.0.1"'],
        "name": ['"web-1"'],
    },
    "[slave.can]": {
        "bit_rate": ["500", "1000"],
        "layout": ['"el6751"', '"esd-c2922"'],
        "identifiers": ["29"],
        "mode": ['"buffered"'],
        "sample_point": ["87", "75.0"],
        "frames_per_second": ["2000", '"full"'],
        "receive_queue": ["1", "32"],
        "send_queue": ["16"],
        "filters": ["[0x181]", '["0x180-0x1FF", "5"]'],
        "flags": ["8"],
    },
    "[[slave.can.safe]]": {
        "id": ["0", "0x1FFFFFFF"],
        "extended": ["true"],
        "remote": ["false"],
        "data": ['"01 00"'],
        "period_ms": ["0", "60000"],
        "identifiers": ["[1, '2-3']"],
        "when": ['"lost"', '"ended"'],
    },
    "[[domain]]": {
        "name": ['"fast"'],
        "divider": ["4", "65535"],
        "phase": ["0", "3"],
        "slaves": ['["press"]', "[0]", "['0-0']"],
    },
    "[dc]": {
        "enabled": ["true"],
        "reference": ["-1", "0", '"press"'],
        "phase_us": ["0", "999.5"],
        "lock_us": ["0.1", "500"],
        "timeout_s": ["300"],
    },
    "[[dc.slave]]": {
        "slave": ["0"],
        "sync0_us": ["0", "4_000_000"],
        "shift_us": ["-4e6", "0", "30.5"],
        "sync1_us": ["0", "125.0"],
    },
    "[health]": {
        "window_s": ["1", "600"],
        "wrong_counters": ["0.0001", "1"],
        "lost": ["0.5"],
        "unsent": ["1.0"],
        "late": ["0.01"],
    },
    "[mailbox]": {"share": ["0.01", "1"]},
    "[recovery]": {"slaves": ['"all"', '"watchdog"', '"none"'], "retry_s": ["0.1", "3600"]},
    "[realtime]": {
        "priority": ["0", "98"],
        "cpu": ["-1", "1023"],
        "lock_memory": ["true"],
        "busy_receive": ["false"],
        "poll_us": ["0", "1000"],
        "dma_latency_us": ["-1"],
    },
    "[outputs]": {
        "lease_cycles": ["1", "1_000_000"],
        "lease_max_ms": ["1", "60000"],
        "wkc_limit": ["0"],
    },
    "[[outputs.safe]]": {
        "slave": SLAVES,
        "entry": ENTRIES,
        "value": ['"zero"', '"hold"', "-3", "2.5", '"quick_stop"'],
        "stop_timeout_s": ["0.01", "30"],
    },
    "[[signal]]": {
        "slave": SLAVES,
        "entry": ENTRIES,
        "name": ['"speed"'],
        "type": ['"int16"', '"real32"'],
        "unit": ['"rpm"'],
        "scale": ["-0.5", "2"],
        "offset": ["1e3"],
        "minimum": ["-3.5"],
        "maximum": ["4"],
        "values": ["{ 0 = 'off', 0x10 = 'on' }"],
    },
    "[[copy]]": {
        "slave": SLAVES,
        "entry": ENTRIES,
        "from_slave": SLAVES,
        "from_entry": ENTRIES,
        "factor": ["-1", "2.5"],
        "offset": ["0"],
    },
    "[gateway]": {
        "host": ['""', '"cell-4.b"'],
        "listen": ["[]", '["tcp/127.0.0.1:7447"]'],
        "connect": ["[]"],
        "router_names": ["[]"],
        "publish_hz": ["0", "1000"],
        "metrics": ['""', '"unix:/run/x"', '"[::1]:1"'],
        "certificate": ['""', '"/etc/ecatd/tls/daemon.pem"'],
        "key": ['""', '"/etc/ecatd/tls/daemon.key"'],
        "users_ca": ['"/etc/ecatd/tls/authority.pem"'],
        "anonymous_reading": ["true", "false"],
        "guests_max": ["2", "1000"],
    },
    "[[gateway.user]]": {
        "name": ['"anna"', '"a.b@c"'],
        "write": ["[]", '["sdo", "state"]'],
        "slaves": ["[]", '[0, "drive"]'],
        "changes_max": ["0.1", "10000"],
        "sessions_max": ["1", "1000"],
    },
}
REQUIRED = {
    "[[gateway.user]]": ["name"],
    "[[slave]]": ["position"],
    "[[slave.module]]": ["slot", "ident"],
    "[[slave.pdo]]": ["index", "entries"],
    "[[slave.startup]]": ["object"],
    "[[slave.idn]]": ["idn"],
    "[[domain]]": ["slaves"],
    "[[dc.slave]]": ["slave"],
    "[[outputs.safe]]": ["slave"],
    "[[signal]]": ["slave", "entry"],
    "[[copy]]": ["slave", "entry", "from_slave", "from_entry"],
}
UNLIMITED = {
    *("[[signal]].scale", "[[signal]].offset", "[[signal]].minimum", "[[signal]].maximum"),
    *("[[copy]].factor", "[[copy]].offset", "[[outputs.safe]].value", "[[slave.startup]].value"),
}
"""Numbers that may have any size that their type allows, or the bus decides."""

ONCE = ("[[slave]]", "[[slave.module]]", "[[slave.pdo]]", "[[dc.slave]]", "[[signal]]", "[[copy]]")
"""Tables of which two with the same slave, slot, index or entry contradict each other."""

MARKS = {"alias", "identification"}
INNER = {
    "slave",
    "safe",
    "module",
    "pdo",
    "startup",
    "idn",
    "domain",
    "signal",
    "copy",
    "eoe",
    "can",
}
NUMBER = re.compile(r"-?[0-9][0-9_.e]*|0x[0-9A-F]+")


@dataclass
class Part:
    """A table of a file: its header and its keys."""

    header: str
    keys: dict[str, str] = field(default_factory=dict)

    @property
    def lines(self) -> list[str]:
        head = [self.header] if self.header else []
        return head + [f"{key} = {value}" for key, value in self.keys.items()]


def text_of(parts: list[Part]) -> str:
    return "\n".join(line for part in parts for line in part.lines) + "\n"


def lines_of(parts: list[Part], part: Part, key: str | None = None) -> range:
    """The lines of a table, or that of one of its keys."""
    at = next(number for number, one in enumerate(parts) if one is part)
    first = 1 + sum(len(one.lines) for one in parts[:at])
    if key is None:
        return range(first, first + len(part.lines))
    line = first + bool(part.header) + list(part.keys).index(key)
    return range(line, line + 1)


# --- valid configurations ------------------------------------------------------------------------


def some_keys(dice: Random, header: str, **fixed: str) -> Part:
    """A table with some of its keys, each with one of its values."""
    chosen = {
        key: dice.choice(values)
        for key, values in VALUES[header].items()
        if key in REQUIRED.get(header, ()) or dice.random() < 0.5
    }
    return Part(header, chosen | fixed)


def slave_parts(dice: Random, number: int, name: str) -> Iterator[Part]:
    """A `[[slave]]` with what belongs to it, without keys that contradict each other."""
    slave = some_keys(dice, "[[slave]]", position=str(number), name=f'"{name}"')
    keys = slave.keys
    drop = {dice.choice(["revision", "revision_min"])}
    if not {"vendor", "product"} <= keys.keys():
        drop |= {"vendor", "product", "revision", "revision_min", "serial", "policy"}
        drop |= {"optional", "group"}
    marks = [key for key in ("alias", "identification") if key in keys]
    drop |= {"position", *marks[1:]} if marks and dice.random() < 0.5 else MARKS
    if "identification" in drop or "identification" not in keys:
        drop |= {"identification_register"}
    for key in drop:
        keys.pop(key, None)
    if "group" in keys:
        keys["group"] = f'"tool-{number}"'
    for mark in MARKS & keys.keys():
        keys[mark] = str(int(keys[mark]) // 2 + number + 1)
    yield slave
    if dice.random() < 0.4:
        yield some_keys(dice, "[[slave.module]]", slot="1")
        yield some_keys(dice, "[[slave.module]]", slot="2")
    if dice.random() < 0.4:
        yield some_keys(dice, "[[slave.pdo]]", index='"0x1600"')
    for _ in range(dice.randrange(3)):
        startup = some_keys(dice, "[[slave.startup]]")
        if "hex" in startup.keys:
            for key in ("type", "value", "unit"):
                startup.keys.pop(key, None)
        else:
            startup.keys |= {"type": '"uint32"', "value": "5"}
        yield startup
    if dice.random() < 0.4:
        idn = some_keys(dice, "[[slave.idn]]", value="100")
        idn.keys.pop("hex", None)
        yield idn
    if dice.random() < 0.4:
        own = {"mac": f'"02:00:00:00:00:0{number}"', "address": f'"192.168.7.{number + 2}/24"'}
        yield some_keys(dice, "[slave.eoe]", **own)
    if dice.random() < 0.4:
        yield some_keys(dice, "[slave.can]", bit_rate="500")
        yield some_keys(dice, "[[slave.can.safe]]", id="0")


def configuration(dice: Random) -> list[Part]:
    """A valid configuration."""
    parts = [some_keys(dice, "", bus='"ecat0"', cycle_time_us="1000")]
    parts += [*slave_parts(dice, 0, "press"), *slave_parts(dice, 1, "lamp")]
    tables = ("expected", "mailbox", "recovery", "realtime", "eoe", "gateway", "health")
    for header in (f"[{name}]" for name in tables):
        if dice.random() < 0.5:
            parts.append(some_keys(dice, header))
    if dice.random() < 0.5:
        parts.append(Part("[[domain]]", {"slaves": "[]"}))
        parts.append(some_keys(dice, "[[domain]]", divider="4", slaves='["press"]'))
    if dice.random() < 0.5:
        parts.append(some_keys(dice, "[dc]", enabled="true", reference='"press"'))
        parts.append(some_keys(dice, "[[dc.slave]]", slave='"lamp"', sync0_us="2000"))
    parts.append(some_keys(dice, "[outputs]"))
    if dice.random() < 0.5:
        safe = some_keys(dice, "[[outputs.safe]]", slave='"press"', entry='"0x6040:00"')
        if safe.keys.get("value") != '"quick_stop"':
            safe.keys.pop("stop_timeout_s", None)
        parts.append(safe)
    if dice.random() < 0.7:
        parts.append(some_keys(dice, "[[signal]]", slave='"press"'))
    if dice.random() < 0.7:
        parts.append(some_keys(dice, "[[copy]]", slave='"lamp"', from_slave='"press"'))
    return parts


def refusal(file: Path, text: str) -> str:
    """What is said about a file, without its name; empty if nothing is."""
    file.write_text(text)
    try:
        load_config(file)
    except ConfigError as error:
        said = str(error)
        assert said.startswith(f"{file}:"), said
        assert "\n" not in said
        return said.removeprefix(f"{file}:")
    return ""


def check(file: Path, text: str, lines: range) -> None:
    """A mistake in some lines is refused with one of them, and with what to do."""
    said = refusal(file, text)
    numbered = "\n".join(f"{n}: {line}" for n, line in enumerate(text.splitlines(), 1))
    assert said, f"nothing is said about {lines} of\n{numbered}"
    where = re.match(r"(\d+): ", said)
    assert where, said
    assert int(where[1]) in lines, f"{said}\n{lines} of\n{numbered}"
    assert REMEDY.search(said), f"no remedy: {said}"
    check_slave(text, said)


def check_slave(text: str, said: str) -> None:
    """A message below a `[[slave]]` names the slave: its number is only that of the table."""
    found = re.match(r"\d+: slave\[(\d+)\].*?(?: \(([^()]*)\))?: ", said)
    if not found:
        return
    table = tomllib.loads(text)["slave"][int(found[1])]
    about = (found[2] or "").split(", ")
    if table.get("position") in (0, 1, 3):
        assert f"slave {table['position']}" in about, said
    if table.get("name") in ("press", "lamp"):
        assert table["name"] in about, said


def test_every_key_has_values(tmp_path: Path) -> None:
    """The reader lists the keys of a table that has an unknown one."""
    for header, values in VALUES.items():
        above = "[[slave]]\nposition = 0\n" if header.strip("[]").startswith("slave.") else ""
        above += "[slave.can]\nbit_rate = 500\n" if header == "[[slave.can.safe]]" else ""
        said = refusal(tmp_path / "x.toml", f"{above}{header}\nzzzzzzzz = 0\n")
        known = set(said.rpartition("the keys here are ")[2].split(", "))
        name = header.strip("[]")
        tables = {other.strip("[]").rpartition(".") for other in VALUES if other}
        below = {table for parent, _, table in tables if parent == name}
        assert known - below == set(values), said


def test_configurations_without_a_mistake_are_taken(tmp_path: Path) -> None:
    for seed in range(inputs(150)):
        text = text_of(configuration(Random(seed)))
        assert refusal(tmp_path / "x.toml", text) == "", text


# --- one mistake ---------------------------------------------------------------------------------

Changed = tuple[str, range]
"""A text with a mistake, and the lines that the message may name."""
Mistake = Callable[[Random, list[Part]], Changed]


def replaced(
    dice: Random, parts: list[Part], value: str, fits: Callable[[Part, str], bool]
) -> Changed:
    """Another value for one of the keys that fit; an unknown key if none does."""
    chosen = [(part, key) for part in parts for key in part.keys if fits(part, key)]
    if not chosen:
        return unknown_key(dice, parts)
    part, key = dice.choice(chosen)
    part.keys[key] = value
    return text_of(parts), lines_of(parts, part, key)


def wrong_type(dice: Random, parts: list[Part]) -> Changed:
    return replaced(dice, parts, "1979-05-27", lambda _part, _key: True)


def out_of_range(dice: Random, parts: list[Part]) -> Changed:
    def fits(part: Part, key: str) -> bool:
        values = VALUES[part.header][key]
        limited = f"{part.header}.{key}" not in UNLIMITED
        return limited and all(NUMBER.fullmatch(value) for value in values)

    return replaced(dice, parts, dice.choice(["-10_000_000", "10_000_000_000_000"]), fits)


def unknown_word(dice: Random, parts: list[Part]) -> Changed:
    """A text that is longer than any name, has two lines, and is no word that is known."""

    def fits(part: Part, key: str) -> bool:
        return all(value[0] in "\"'" for value in VALUES[part.header][key])

    return replaced(dice, parts, '"' + "~" * 300 + '\\n"', fits)


def nobody(dice: Random, parts: list[Part]) -> Changed:
    keys = {
        *("[[dc.slave]].slave", "[dc].reference", "[[outputs.safe]].slave", "[[signal]].slave"),
        *("[[copy]].slave", "[[copy]].from_slave"),
    }
    return replaced(dice, parts, '"nobody"', lambda part, key: f"{part.header}.{key}" in keys)


def nobody_in_a_domain(dice: Random, parts: list[Part]) -> Changed:
    return replaced(
        dice, parts, '["nobody"]', lambda part, key: f"{part.header}.{key}" == "[[domain]].slaves"
    )


def unknown_key(dice: Random, parts: list[Part]) -> Changed:
    part = dice.choice(parts)
    name = dice.choice(["zzz", "Name", "position_", '"a b"'])
    part.keys[name] = "1"
    return text_of(parts), lines_of(parts, part, name)


def key_of_another_table(dice: Random, parts: list[Part]) -> Changed:
    part = dice.choice(parts)
    other = VALUES[dice.choice([header for header in VALUES if header != part.header])]
    tables = {header.strip("[]") for header in VALUES} if not part.header else set()
    known = {*VALUES[part.header], *INNER, *tables}
    strange = [key for key in other if key not in known]
    if not strange:
        return unknown_key(dice, parts)
    key = dice.choice(strange)
    part.keys[key] = other[key][0]
    return text_of(parts), lines_of(parts, part, key)


def twice(dice: Random, parts: list[Part]) -> Changed:
    """The same key a second time, which is no TOML."""
    part = dice.choice([part for part in parts if part.keys])
    (line,) = lines_of(parts, part, dice.choice(list(part.keys)))
    lines = text_of(parts).splitlines()
    lines.insert(line, lines[line - 1])
    return "\n".join(lines), range(line, line + 2)


def table_twice(dice: Random, parts: list[Part]) -> Changed:
    part = dice.choice([part for part in parts if part.header in ONCE])
    again = Part(part.header, dict(part.keys))
    at = next(number for number, one in enumerate(parts) if one is part)
    parts.insert(at + 1, again)
    return text_of(parts), lines_of(parts, again)


def missing(dice: Random, parts: list[Part]) -> Changed:
    wanted = [
        (part, key)
        for part in parts
        for key in REQUIRED.get(part.header, ())
        # A mark stands in place of the position, and domain 0 has all slaves that are left.
        if key in part.keys and not MARKS & part.keys.keys() and part.keys[key] != "[]"
    ]
    if not wanted:
        return unknown_key(dice, parts)
    part, key = dice.choice(wanted)
    del part.keys[key]
    return text_of(parts), lines_of(parts, part)


MISTAKES: list[Mistake] = [
    *(wrong_type, out_of_range, unknown_word, nobody, nobody_in_a_domain, unknown_key),
    *(key_of_another_table, twice, table_twice, missing),
]


@pytest.mark.parametrize("mistake", MISTAKES)
def test_one_mistake_is_refused_in_one_sentence(tmp_path: Path, mistake: Mistake) -> None:
    for seed in range(inputs(1_500) // len(MISTAKES)):
        dice = Random(seed)
        text, lines = mistake(dice, configuration(dice))
        check(tmp_path / "x.toml", text, lines)


# --- keys that contradict each other -------------------------------------------------------------

STARTUP = {"object": '"0x1:0"'}
DEVICE = {"position": "3", "vendor": "2", "product": "3"}
SIGNAL = {"slave": "0", "entry": '"0x1:0"'}
COPY = {"slave": "0", "entry": '"0x1:0"', "from_slave": "0", "from_entry": '"0x2:0"'}
CONTRADICTIONS: list[tuple[str, dict[str, str]]] = [
    ("", {"interface": '"eth1"', "second_interface": '"eth1"'}),
    ("[[slave]]", {"position": "3", "alias": "7"}),
    ("[[slave]]", {"alias": "7", "identification": "8"}),
    ("[[slave]]", {"position": "3", "identification_register": "0x1000"}),
    *(("[[slave]]", {"position": "3", key: "2"}) for key in ("vendor", "product", "serial")),
    ("[[slave]]", {"position": "3", "policy": '"strict"'}),
    ("[[slave]]", {"position": "3", "optional": "true"}),
    ("[[slave]]", {"position": "3", "group": '"x"'}),
    ("[[slave]]", DEVICE | {"group": '"x"', "optional": "false"}),
    ("[[slave]]", DEVICE | {"revision": "1", "revision_min": "1"}),
    ("[[slave]]", {"position": "3", "name": '"press"'}),
    ("[[slave]]", {"position": "3", "pdos": "[0x1600, 0x1600]"}),
    ("[[slave]]", {"position": "3", "pdos": f"[{', '.join(map(str, range(0x1600, 0x1650)))}]"}),
    ("[[slave.pdo]]", {"index": "0x1601", "entries": f"[{', '.join(['{ bits = 1 }'] * 255)}]"}),
    ("[[slave.startup]]", STARTUP | {"hex": '"00"', "value": "1"}),
    ("[[slave.startup]]", STARTUP | {"value": "1"}),
    ("[[slave.startup]]", STARTUP | {"type": '"int8"'}),
    *(
        ("[[slave.startup]]", STARTUP | {"type": f'"{kind}"', "value": value})
        for kind, value in (
            *(("int8", "200"), ("int8", "2.5"), ("int8", '"x"'), ("nothing", "1")),
            *(("real32", "nan"), ("real32", "1e300"), ("octet_string", '"0"')),
        )
    ),
    ("[[slave.startup]]", STARTUP | {"type": '"bool"', "value": "1", "unit": '"rad"'}),
    ("[[slave.startup]]", STARTUP | {"type": '"int8"', "value": "1", "complete": "true"}),
    ("[[slave.startup]]", {"object": '"0x1:5"', "hex": '"00"', "complete": "true"}),
    ("[[slave.startup]]", {"object": '"0x1:FF"', "hex": '"00"'}),
    ("[[slave.startup]]", STARTUP | {"hex": '""'}),
    ("[[slave.startup]]", STARTUP | {"hex": '"0"'}),
    ("[[domain]]", {"slaves": "[ ]"}),
    ("[[domain]]", {"slaves": "[1, 1]"}),
    ("[[domain]]", {"slaves": "['5-2']"}),
    ("[[domain]]", {"slaves": "[1]", "divider": "4", "phase": "4"}),
    ("[[dc.slave]]", {"slave": "1", "sync0_us": "1.5"}),
    ("[[outputs.safe]]", {"slave": "0", "value": "5"}),
    ("[[outputs.safe]]", {"slave": "0", "value": '"hold"', "stop_timeout_s": "1"}),
    ("[[outputs.safe]]", {"slave": "0", "value": '"fast"'}),
    ("[[signal]]", SIGNAL | {"minimum": "2", "maximum": "1"}),
    ("[[signal]]", SIGNAL | {"scale": "0"}),
    ("[[signal]]", SIGNAL | {"values": "{ x = 'y' }"}),
    ("[[signal]]", SIGNAL | {"values": "{ 1 = 'y', 0x1 = 'z' }"}),
    ("[[signal]]", SIGNAL | {"values": "{ 1 = '' }"}),
    ("[[copy]]", COPY | {"entry": '"0x1"'}),
    ("[[copy]]", COPY | {"factor": "0"}),
    ("[gateway]", {"listen": '["here"]'}),
    ("[gateway]", {"connect": '["tcp/hub:1"]', "anonymous_reading": "true"}),
    ("[gateway]", {"connect": '["tcp/hub:1"]', "host": '"a"'}),
    ("[gateway]", {"connect": '["tls/hub:1"]', "host": '"a"'}),
    ("[gateway]", {"connect": '["unixsock-stream//x"]', "host": '"a"'}),
    ("[gateway]", {"router_names": '["hub"]'}),
]


@pytest.mark.parametrize(("header", "keys"), CONTRADICTIONS)
def test_keys_that_contradict_each_other_are_refused(
    tmp_path: Path, header: str, keys: dict[str, str]
) -> None:
    part = Part(header, keys)
    parts = [Part("[[slave]]", {"position": "0", "name": '"press"'})]
    parts += [Part("[[domain]]", {"slaves": "[]"})] * (header == "[[domain]]")
    parts.insert(len(parts) if header else 0, part)
    check(tmp_path / "x.toml", text_of(parts), lines_of(parts, part))
