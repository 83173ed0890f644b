"""Builds the intermediate representation of a library from its parts."""

from __future__ import annotations

from collections.abc import Iterable

from ecatd.description.bus import Bus

from . import names, static_library
from .blocks import build_blocks, renamed
from .can.messages import CanFile
from .channels import build_channels
from .drives import build_drives
from .examples import build_examples
from .ir import Block, Library
from .text import Code


def build_library(bus: Bus, name: str, can: Iterable[CanFile] = ()) -> Library:
    """Builds the library for a bus.

    Args:
        bus: The bus.
        name: Name of the library.
        can: The messages of CAN buses behind its slaves.

    Raises:
        UsageError: `name` cannot be the name of a Modelica library.
    """
    library = names.library_name(name)
    blocks = build_blocks(bus.slaves, library, can)
    drives, notes = build_drives(blocks)
    return Library(
        name=library,
        description=f"Slaves of the EtherCAT bus {bus.name}",
        bus=bus.name,
        cycle_time_us=bus.cycle_time_us,
        fingerprint=Code("%016x") % bus.fingerprint,
        command=f"ecatctl generate {name} DIR",
        version=static_library.VERSION,
        blocks=blocks,
        drives=drives,
        channels=build_channels(blocks),
        notes=renamed(blocks) + notes + left_out(blocks),
        examples=build_examples(bus, library, blocks, drives),
    )


def left_out(blocks: Iterable[Block]) -> tuple[str, ...]:
    """Returns a sentence for all that files have, and blocks have not."""
    return tuple(
        f"slave {block.position} {block.name}: left out: {sentence}"
        for block in blocks
        for sentence in block.can.left_out
    )
