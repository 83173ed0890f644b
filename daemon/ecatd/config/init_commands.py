"""Makes start-up parameters of the commands that ESI and ENI files have for objects."""

from __future__ import annotations

from ecatd.base.errors import UsageError
from ecatd.description.object_types import ObjectType
from ecatd.etg.datatypes import STRINGS, decode, type_alias

from .startup import COMMENT_BYTES, DATA_MAX, StartupConfig


def startup_parameter(
    known: ObjectType,
    address: tuple[int, int],
    data: bytes,
    *,
    complete: bool,
    transition: str,
    comment: str,
) -> StartupConfig:
    """Makes a start-up parameter of the bytes that are written.

    It has a type and a value if they give the same bytes again, else hexadecimal bytes.

    Args:
        known: What is known about the object.
        address: Index and subindex.
        data: The bytes.
        complete: Whether the whole object is written at once.
        transition: When it is written, one of `TRANSITIONS`.
        comment: Why it is written; what cannot be printed is left out.

    Raises:
        UsageError: The configuration cannot have such a parameter; the message says why.
    """
    if not 0 < len(data) <= DATA_MAX:
        raise UsageError(f"it has {len(data)} bytes of data: 1 to {DATA_MAX} can be written")
    if complete and address[1] > 1:
        raise UsageError("complete access begins at subindex 00 or 01")
    if address[1] > 0xFE:
        raise UsageError("a subindex is at most 0xFE")
    words = " ".join("".join(c if c.isprintable() else " " for c in comment).split())
    parameter = StartupConfig(
        f"0x{address[0]:04X}:{address[1]:02X}",
        complete=complete,
        transition=transition,
        comment=words.encode()[:COMMENT_BYTES].decode("utf-8", "ignore"),
    )
    kind = known.of(data).data_type
    parameter.type = None if complete or kind in STRINGS else type_alias(kind)
    if parameter.type is not None:
        parameter.value = str(decode(kind, data))
        try:
            if parameter.data == data:
                return parameter
        except UsageError:
            pass
    parameter.type, parameter.value, parameter.hex = None, None, data.hex(" ").upper()
    return parameter
