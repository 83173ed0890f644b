"""Lines about changes: which ones are told together, and what they say."""

from __future__ import annotations

import asyncio
from typing import Any

from conftest import names
from ecatd.base.log import Log
from ecatd.server.requests.changes import Changes


def test_values_of_an_output_that_is_moved_by_hand_are_told_together() -> None:
    events: list[dict[str, Any]] = []

    async def move() -> None:
        changes = Changes(Log("test"), events.append)
        before = ""
        for value in (1, 5, 900, -3, 7, 6):
            with changes.record("output A", str(value), "anna", before=before, holding="page"):
                before = str(value)
            if value == 1:
                await asyncio.sleep(0.1)  # the first value is told at once
        with changes.record("output B", "1", "anna", holding="page"):
            pass
        with changes.record("output A", "2", "carl"):  # another one does not wait for the hand
            pass
        changes.end_holding("page")
        changes.end_holding("page")

    asyncio.run(move())
    texts = [event["text"] for event in events]
    assert texts[0] == "output A: changed to 1 by anna"
    assert texts[1] == "output A: changed to 2 by carl"
    names(texts[2], "output A: changed 5 times, from 1 to 6", "between -3 and 900", "by anna")
    assert texts[3:] == ["output B: changed to 1 by anna"]
    assert [event["times"] for event in events] == [1, 1, 5, 1]
