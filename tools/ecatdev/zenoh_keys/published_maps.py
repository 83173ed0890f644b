"""Maps that are published: values, streams, and the kinds of events."""

from __future__ import annotations

from typing import NotRequired, TypedDict

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
