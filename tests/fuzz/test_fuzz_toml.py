"""Mutated TOML: taken, or refused in one sentence with file, line and key.

Rig and device files have the same in `tests/unit/test_ecatsim_rig_file.py` and beside it.
"""

import random
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from mutations import inputs, mutants

from ecatd.base.errors import ConfigError
from ecatd.base.toml_places import find_places
from ecatd.config import Config, load_config, profiles
from ecatd.config.profiles import load_profiles

pytestmark = pytest.mark.long

CONFIG = """\
bus = "rig" # a [comment]
interface = 'eth1'
cycle_time_us = 250
profiles = ["/nowhere",
  '/here']
realtime.cpu = 1
realtime.lock_memory = false

[[slave]]
position = 3
pdos = ["0x1605", 0x1A02]
[[slave.pdo]]
index = 0x1605
entries = [{ object = "0x6040:00", bits = 16 },
  { bits = 8 }]
[[slave.startup]]
object = "0x6065:00" # window
type = "uint32"
value = 1234
[[slave.startup]]
object = "0x1C32:00"
hex = "01 00"
complete = true
transition = 'SO'

[[domain]]
name = "fast"
[[domain]]
divider = 4
phase = 3
slaves = [
  3, # the valve
  "5-7",
]

[dc]
reference = 0x2
slave = [{ slave = 0, sync0_us = 125, shift_us = -30.5 },
  { slave = 6 }]

[outputs]
lease_cycles = 7
[[outputs.safe]]
slave = 3
value = "hold"
[[outputs.safe]]
slave = 0
entry = "0x60FF:00"
value = -5

[[signal]]
slave = 0
entry = "0x60FF:00"
unit = "rpm"
scale = 0.5
maximum = 1e3
[signal.values]
0 = "off"
0x10 = \"""on\"""

[gateway]
listen = ["tcp/127.0.0.1:7000"]
publish_hz = 2.5
"""
PROFILE = """\
[[device]]
description = "A [sensor]"
vendor = 0xF00D
product = [0x13,
  0x14]

[[device.entry]]
index = 0x6000
subindex = [1, 3]
step = 16
count = 2
unit = "V"
raw = [0, 32767]
physical = [0.0, 10.0]

[[device]]
description = 'Another'
has = ["0x6041:00"]
entry = [
  { index = 0x6041, note = "bits" },
  { index = 0x6061, connector = false, values = { 1 = "one", -1 = 'less' } },
]
"""


def load_profile(file: Path) -> None:
    """The devices of a file, which is alone in its folder."""
    folder = file.parent / "profiles"
    folder.mkdir(exist_ok=True)
    shutil.copy(file, folder / "x.toml")
    try:
        load_profiles(Config(profiles=[str(folder)]))
    except ConfigError as error:
        raise ConfigError(str(error).replace(f"{folder / 'x.toml'}", str(file))) from None


OURS = [file.read_text() for file in Path(profiles.__file__).parent.glob("*.toml")]
FILES = [(CONFIG, load_config), (PROFILE, load_profile), *((text, load_profile) for text in OURS)]
Load = Callable[[Path], object]


def said_about(file: Path, data: str | bytes, load: Load) -> str:
    """What is wrong with a file, without its name; empty if nothing is."""
    file.write_bytes(data if isinstance(data, bytes) else data.encode())
    try:
        load(file)
    except ConfigError as error:
        said = str(error)
        assert "\n" not in said
        assert said.startswith(f"{file}:")
        return said.removeprefix(f"{file}:")
    return ""


@pytest.mark.parametrize(("text", "load"), FILES)
def test_each_value_of_a_wrong_type_is_named(tmp_path: Path, text: str, load: Load) -> None:
    file = tmp_path / "x.toml"
    assert said_about(file, text, load) == ""
    named = 0
    for path, place in find_places(text).items():
        if not place.value:
            continue
        lines = text.splitlines()
        old = lines[place.line - 1]
        lines[place.line - 1] = old.replace(place.value, "1979-05-27", 1)
        said = said_about(file, "\n".join(lines), load)
        where = re.match(r"(\d+): (\S+)( \(slave \d+[^)]*\))?: ", said)
        assert where, (path, said)
        assert int(where[1]) == place.line, (path, said)
        key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
        # One value may stand in front of the one that is meant, in the same line.
        assert where[2] == key[1:] or old.count(place.value) > 1, (path, said)
        named += 1
    assert named > 10


@pytest.mark.parametrize(("text", "load"), FILES)
def test_each_unknown_key_is_named(tmp_path: Path, text: str, load: Load) -> None:
    lines = text.splitlines()
    tables = [number for number, line in enumerate(lines, 1) if line.startswith("[")]
    for number in tables:
        changed = [*lines[:number], "zzz = 3", *lines[number:]]
        said = said_about(tmp_path / "x.toml", "\n".join(changed), load)
        assert re.match(
            rf"{number + 1}: \S+\.zzz( \(slave \d+[^)]*\))?: is (not a|no) (key|whole number)", said
        ), said
    assert len(tables) >= 3


TOKENS = [
    *("", "\n", "[", "]", "[[", "]]", "{", "}", '"', "'", '"""', "=", ".", ",", "#", "\0", "é"),
    *("0", "-1", "0xFFFF", "1e400", "nan", "true", "''", "[]", "{}", "[[1]]", "9" * 30),
    *("1979-05-27", "slave = 1", "[dc]", "[[signal]]", "[[device]]", "zzz", "a.b", '"\\u0000"'),
]
PIECES = re.compile(r"\s+|[A-Za-z0-9_.\-]+|.")


@pytest.mark.parametrize(("text", "load"), FILES)
def test_changed_texts(tmp_path: Path, text: str, load: Load) -> None:
    dice, whole = random.Random(1), PIECES.findall(text)
    for _ in range(inputs(2_000) // len(FILES)):
        pieces = list(whole)
        for _ in range(dice.randrange(1, 5)):
            pieces[dice.randrange(len(pieces))] = dice.choice(TOKENS)
        changed = "".join(pieces)
        said = said_about(tmp_path / "x.toml", changed, load)
        assert re.fullmatch(r"(\d+: .+)?", said), changed


@pytest.mark.parametrize(("text", "load"), FILES[:2])
def test_changed_bytes(tmp_path: Path, text: str, load: Load) -> None:
    for data in mutants([text.encode()], inputs(2_000) // 2, 1):
        said = said_about(tmp_path / "x.toml", data, load)
        assert re.fullmatch(r"(\d+: .+| is nested too deeply)?", said)
