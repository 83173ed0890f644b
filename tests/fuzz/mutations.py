"""Seeded mutations of byte strings, the same on every machine."""

import random
from collections.abc import Iterator, Sequence


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
