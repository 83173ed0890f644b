"""Mutated ESI files: made into devices, or refused with the documented error."""

import random
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from mutations import mutants

sys.path.insert(0, str(Path(__file__).parents[1] / "unit"))

from esi_sample import SAMPLE

from ecatd.model.errors import ConfigError
from ecatsim.core import Segment
from ecatsim.files.esi import device_from_esi

pytestmark = pytest.mark.long


FILES, SHARDS = 4_000, 2
PIECES = re.compile(r"<[^>]*>|[^<]+")
VALUES = ["0", "1", "-1", "255", "65536", "#xFFFFFFFF", "#x", "", "UINT", "STRING(65535)", "DT2000"]
VALUES += ["ARRAY [0..99999] OF BYTE", "DT2001ARR", "RW", "1e999", "nan", "\u2603", "00" * 300]


def mutated_elements(count: int, seed: int) -> Iterator[bytes]:
    """Well-formed more often than not: tags and texts are exchanged, doubled or left out."""
    dice = random.Random(seed)
    whole = PIECES.findall(SAMPLE)
    texts = [i for i, piece in enumerate(whole) if piece[0] != "<" and piece.strip()]
    ends = {i: _end(whole, i) for i, piece in enumerate(whole) if re.match(r"<\w[^/]*>$", piece)}
    for _ in range(count):
        pieces = list(whole)
        for _ in range(dice.choice((1, 1, 2, 5))):
            kind = dice.randrange(4)
            start = dice.choice(list(ends)[2:])
            if kind == 0:
                pieces[dice.choice(texts)] = dice.choice(VALUES)
            elif kind == 1:
                pieces[start] = re.sub('"[^"]*"', f'"{dice.choice(VALUES)}"', pieces[start])
            elif kind == 2:
                for i in range(start, ends[start] + 1):
                    pieces[i] = ""
            else:
                pieces[start] = "".join(whole[start : ends[start] + 1]) + pieces[start]
        yield "".join(pieces).encode()


def _end(pieces: list[str], start: int) -> int:
    """Where the element ends that begins at `start`."""
    depth = 0
    for i in range(start, len(pieces)):
        piece = pieces[i]
        depth += piece.startswith("<") and piece[1] not in "/!?" and not piece.endswith("/>")
        depth -= piece.startswith("</")
        if depth == 0:
            return i
    raise AssertionError(pieces[start])


@pytest.mark.parametrize("shard", range(SHARDS))
def test_mutated_files_become_devices_or_are_refused(shard: int, tmp_path: Path) -> None:
    path = tmp_path / "x.xml"
    count = FILES // SHARDS // 2
    accepted = refused = 0
    for data in (
        *mutants([SAMPLE.encode()], count, shard),
        *mutated_elements(count, shard),
    ):
        path.write_bytes(data)
        segment = Segment()
        try:
            device_from_esi(path, "AX2", revision=0x00020001).attach(segment, 0, 0)
            accepted += 1
        except ConfigError as error:
            refused += 1
            message = str(error)
            if not message.startswith(f"{path}:"):
                pytest.fail(message)
        finally:
            segment.close()
    assert refused > count / 4, "mutations must do harm"
    assert accepted > count / 4, "and not always"
