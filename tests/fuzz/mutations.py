"""Seeded mutations of byte strings, the same on every machine."""

import os
import random
import re
from collections.abc import Iterator, Sequence

_PIECES = re.compile(r"<[^>]*>|[^<]+")


def inputs(usual: int) -> int:
    """How many inputs a test tries: as usual, or as many as `make fuzz` wants."""
    return int(os.environ.get("ECAT_INPUTS", usual))


def mutants(seeds: Sequence[bytes], count: int, seed: int) -> Iterator[bytes]:
    """Mutated copies: flipped bits, changed bytes and words, cuts, splices, repeated pieces."""
    dice = random.Random(seed)
    for _ in range(count):
        data = bytearray(dice.choice(seeds))
        for _ in range(dice.choice((1, 1, 1, 2, 4, 16))):
            _mutate(data, seeds, dice)
        yield bytes(data)


def _mutate(data: bytearray, seeds: Sequence[bytes], dice: random.Random) -> None:
    at = dice.randrange(len(data) + 1)
    kind = dice.randrange(8)
    if kind == 0 and at < len(data):
        data[at] ^= 1 << dice.randrange(8)
    elif kind == 1 and at < len(data):
        data[at] = dice.choice((0, 1, 0x7F, 0x80, 0xFF, dice.randrange(256)))
    elif kind == 2:
        data[at : at + 2] = dice.choice((b"\0\0", b"\xff\xff", b"\0\x80", dice.randbytes(2)))
    elif kind == 3:
        del data[at:]
    elif kind == 4:
        del data[at : at + dice.choice((1, 2, 8, 64))]
    elif kind == 5:
        other = dice.choice(seeds)
        start = dice.randrange(len(other) + 1)
        data[at:at] = other[start : start + dice.choice((1, 2, 8, 32, 256))]
    elif kind == 6:
        data[at:at] = data[at : at + dice.choice((2, 8, 64))] * dice.choice((1, 2, 20))
    else:
        data[at : at + 1] = dice.randbytes(dice.choice((1, 4, 16)))


def mutated_elements(sample: str, values: Sequence[str], count: int, seed: int) -> Iterator[bytes]:
    """XML, well-formed more often than not: tags and texts are exchanged, doubled or left out."""
    dice = random.Random(seed)
    whole = _PIECES.findall(sample)
    texts = [i for i, piece in enumerate(whole) if piece[0] != "<" and piece.strip()]
    ends = {i: _end(whole, i) for i, piece in enumerate(whole) if re.match(r"<\w[^/]*>$", piece)}
    for _ in range(count):
        pieces = list(whole)
        for _ in range(dice.choice((1, 1, 2, 5))):
            kind = dice.randrange(4)
            start = dice.choice(list(ends)[2:])
            if kind == 0:
                pieces[dice.choice(texts)] = dice.choice(values)
            elif kind == 1:
                pieces[start] = re.sub('"[^"]*"', f'"{dice.choice(values)}"', pieces[start])
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
