"""Checks rows of the shared memory before they are used, as the C client does.

Each check returns what is wrong with a row, as words that follow its place in a message, or "".
"""

from __future__ import annotations

from typing import Any

from . import contract as shm


def domain_faults(row: Any, head: Any) -> str:
    """What is wrong with an `ecat_shm_domain`, besides its page."""
    if row.output_bytes > row.image_bytes:
        return f"has {row.output_bytes} bytes of outputs in an image of {row.image_bytes}"
    if row.output_base + row.output_bytes > head.output_bytes:
        return f"has outputs beyond the {head.output_bytes} bytes of a client's output image"
    if row.divider == 0:
        return "has divider 0"
    return _endless(row)


def slave_faults(row: Any, head: Any, domains: list[Any]) -> str:
    """Says what is wrong with an `ecat_shm_slave`; empty if nothing is."""
    if row.domain >= len(domains):
        return f"is in domain {row.domain}, and there are {len(domains)}"
    domain = domains[row.domain]
    if row.output_offset + row.output_bytes > domain.output_bytes:
        return f"has outputs beyond the {domain.output_bytes} bytes of domain {row.domain}"
    if row.input_offset + row.input_bytes > domain.image_bytes:
        return f"has inputs beyond the {domain.image_bytes} bytes of domain {row.domain}"
    if row.signals_first + row.signals_count > head.signal_count:
        return f"has entries beyond the {head.signal_count} signals"
    return _endless(row)


def signal_faults(row: Any, head: Any, domains: list[Any]) -> str:
    """Says what is wrong with an `ecat_shm_signal`; empty if nothing is."""
    if row.slave >= head.slave_count:
        return f"is of slave {row.slave}, and there are {head.slave_count}"
    if row.domain >= len(domains):
        return f"is in domain {row.domain}, and there are {len(domains)}"
    if not 1 <= row.bit_length <= 64:
        return f"has {row.bit_length} bits"
    domain = domains[row.domain]
    room = 8 * (domain.output_bytes if row.output else domain.image_bytes)
    if row.bit_offset + row.bit_length > room:
        return f"ends at bit {row.bit_offset + row.bit_length} of the {room} of domain {row.domain}"
    return _endless(row)


def output_faults(row: Any, head: Any) -> str:
    """What is wrong with an `ecat_shm_output`."""
    if not -1 <= row.owner < head.slot_count:
        return f"belongs to slot {row.owner}, and there are {head.slot_count}"
    return ""


def _endless(row: Any) -> str:
    """A text that is not ended."""
    for field in shm.fields_of(type(row).__name__):
        if field.type == "char" and len(getattr(row, field.name)) == field.count:
            return f"has a {field.name} without end"
    return ""
