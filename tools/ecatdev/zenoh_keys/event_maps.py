"""Maps of the kinds of events, made of their table."""

from __future__ import annotations

from typing import NotRequired

from ecatd.operations.events import FACTS, KINDS, Kind


def _facts_of(kind: Kind) -> type:
    """The keys of events of a kind, as a map."""
    types = {
        name.rstrip("?"): NotRequired[FACTS[name.rstrip("?")].type]
        if name.endswith("?")
        else FACTS[name].type
        for name in kind.facts
    }
    return type(kind.name, (dict,), {"__annotations__": types, "__doc__": f"{kind.subject}."})


EVENTS = {name: _facts_of(KINDS[name]) for name in KINDS if KINDS[name].published}
"""The facts of each kind of event, beside those that all have."""
