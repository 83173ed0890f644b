"""The last sample of a domain as a structured array of numpy."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby
from typing import TYPE_CHECKING, Any

from ecatd.base.errors import UsageError

from .signals import Signal, letter

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def view(signals: Iterable[Signal], image: memoryview) -> NDArray[np.void]:
    """A read-only array without dimensions on an image.

    Args:
        signals: The entries of the domain.
        image: Its last sample.

    Raises:
        UsageError: numpy is not installed.
    """
    try:
        import numpy as np
    except ImportError:
        raise UsageError(
            "domain_array() needs numpy: install it with 'pip install ecatd[numpy]'"
        ) from None
    fields = list(_fields(sorted(signals, key=lambda signal: signal.bit_offset)))
    kind = np.dtype(
        {
            "names": [name for name, _form, _offset in fields],
            "formats": [form for _name, form, _offset in fields],
            "offsets": [offset for _name, _form, offset in fields],
            "itemsize": len(image),
        }
    )
    return np.ndarray((), kind, buffer=image)


def _fields(signals: list[Signal]) -> Iterator[tuple[str, Any, int]]:
    """Name, format and offset in bytes of each field."""
    bits: dict[int, int] = {}  # number of fields of bits that each slave has already
    for whole, run in groupby(signals, key=lambda s: (s.slave, s.output, bool(letter(s)))):
        entries = list(run)
        slave, _output, is_whole = whole
        if is_whole:
            yield from ((s.path, "<" + letter(s), s.bit_offset // 8) for s in entries)
            continue
        first = entries[0].bit_offset // 8
        end = -(-(entries[-1].bit_offset + entries[-1].bit_length) // 8)
        yield f"{slave}/bits{bits.setdefault(slave, 0)}", ("u1", (end - first,)), first
        bits[slave] += 1
