"""The line of each change that somebody asks for: what, values, who, and the outcome.

A change over Zenoh has a line of its own. A program with shared memory may write an object at each
sample, so its changes are told together, at growing intervals: one line for each object. So are the
values of outputs that somebody moves by hand, each second.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import partial
from typing import Any

from ecatd.base.batch import Batch
from ecatd.base.errors import EcatError, NoAnswerError
from ecatd.base.log import Log
from ecatd.operations.events import new_event

ZENOH = -1
"""In place of the slot of a program: the request came over Zenoh."""
_asking: ContextVar[int] = ContextVar("slot", default=ZENOH)
"""The slot of the program whose request is being carried out."""
_OF_HAND_S = 1.0
"""Seconds of the longest interval between two lines about an output that is moved by hand."""
SHOWN = 32
"""Bytes of a value in a line."""


@dataclass(frozen=True, slots=True)
class Words:
    """How a kind of change is told.

    Attributes:
        done: What has been done to it.
        noun: The same as a noun, for what has failed.
    """

    done: str
    noun: str


CHANGED = Words("changed", "change")
"""The only kind whose line has the wanted value: `changed from 1 to 2 by anna`."""
CLEARED = Words("cleared", "clearing")
DELETED = Words("deleted", "deletion")
ASKED_FOR = Words("asked for", "request")


@dataclass(slots=True)
class Change:
    """A change that is being made.

    Attributes:
        what: What changes.
        after: The wanted value.
        by: Who asks for it.
        before: The value before; empty if it is not known. It is known if a change of the same
            thing by the same program waits to be told: a program that writes an object at each
            sample must not take twice the time.
        is_recorded: Whether there is a line about it.
        is_secret: Whether its values may be secrets, such as passwords, so that only the log and
            the audit file of this machine have them.
        problem: Why it failed; empty if it did not.
        is_doubtful: Whether it may have been made although it failed.
        words: How it is told.
        note: What stands behind the problem.
    """

    what: str
    after: str
    by: str
    before: str = ""
    is_recorded: bool = True
    is_secret: bool = False
    problem: str = ""
    is_doubtful: bool = False
    words: Words = CHANGED
    note: str = ""

    @property
    def result(self) -> str:
        """The value afterwards; empty if it is not known."""
        return "" if self.is_doubtful else self.before if self.problem else self.after

    def fail(self, error: BaseException) -> None:
        """Notes why it failed."""
        # Any other error ends the work somewhere, perhaps after the slave has got the request.
        self.is_doubtful = isinstance(error, NoAnswerError) or not isinstance(error, EcatError)
        self.problem = (str(error) or "nobody waits for the answer any more") + self.note


@contextmanager
def asked_by(slot: int) -> Iterator[None]:
    """Says which program asks for the changes of the block: its slot, or `ZENOH`."""
    token = _asking.set(slot)
    try:
        yield
    finally:
        _asking.reset(token)


class Changes:
    """Records changes: a line of the log, and an event. For the thread of the event loop.

    Args:
        log: The log for changes.
        publish: Called with each line as an event, which is a map.
    """

    def __init__(
        self, log: Log, publish: Callable[[dict[str, Any]], None] = lambda _event: None
    ) -> None:
        self._log = log
        self._publish = publish
        self._batches: dict[Hashable, Batch[Change]] = {}  # by slot, or by holding
        self._waiting: dict[Hashable, dict[str, Change]] = {}  # the last ones in a batch, by `what`

    @contextmanager
    def record(
        self,
        what: str,
        after: str,
        by: str,
        *,
        before: str = "",
        is_secret: bool = False,
        holding: Hashable = None,
        words: Words = CHANGED,
        note: str = "",
    ) -> Iterator[Change]:
        """Records the change that the block makes, also if it fails.

        Args:
            what: What changes.
            after: The wanted value; not of `DELETED` and the like.
            by: Who asks for it.
            before: The value before, if it is known.
            is_secret: See `Change`.
            words: See `Change`.
            note: See `Change`.
            holding: Of outputs that are held by hand, whose changes are told together; until
                `end_holding`.
        """
        source = _asking.get() if holding is None else holding
        earlier = self._waiting.get(source, {}).get(what)
        before = earlier.result if earlier else before
        change = Change(what, after, by, before, is_secret=is_secret, words=words, note=note)
        try:
            yield change
        except BaseException as error:
            change.fail(error)
            raise
        finally:
            if change.is_recorded:
                self._note(change, source, holding)

    def _note(self, change: Change, source: Hashable, holding: Hashable) -> None:
        if source == ZENOH:
            self._record([change])
            return
        if source not in self._batches:
            tell = partial(self._record_all, source)
            self._batches[source] = (
                Batch(tell) if holding is None else Batch(tell, longest=_OF_HAND_S)
            )
        self._waiting.setdefault(source, {})[change.what] = change
        self._batches[source].note(change)

    def end_holding(self, holding: Hashable) -> None:
        """Records what waits of outputs that were held by hand."""
        if batch := self._batches.pop(holding, None):
            batch.close()

    def _record_all(self, source: Hashable, changes: list[Change], left_out: int) -> None:
        self._waiting.pop(source, None)
        groups: dict[tuple[str, str, bool, bool], list[Change]] = {}
        for item in changes:
            alike = item.what, item.by, bool(item.problem), item.is_doubtful
            groups.setdefault(alike, []).append(item)
        if left_out:
            self._log.notice(
                f"{left_out} earlier changes by {changes[0].by} are not told, because they came "
                "too often"
            )
        for group in groups.values():
            self._record(group)

    def _record(self, alike: Sequence[Change]) -> None:
        """Writes one line about changes of the same thing."""
        first, last = alike[0], alike[-1]
        was = f"from {first.before} " if first.before else ""
        often = f" {len(alike)} times" if len(alike) > 1 else ""
        outcome = "may have been made" if last.is_doubtful else "has failed"

        def line(values: str, more: str = "") -> str:
            words = last.words
            if not last.problem:
                return (
                    f"{last.what}: {words.done}{often and often + ','} {values}by {last.by}{more}"
                )
            how = f"{outcome}{often}: {last.problem}"
            return f"{last.what}: {words.noun} {values}by {last.by} {how}"

        if last.words is CHANGED:
            text = line(f"{was}to {last.after}{_between(alike)} ")
        else:
            text = line("", f"; before: {first.before}" if first.before else "")
        redacted = line("") if last.is_secret else ""
        facts = {"what": last.what, "by": last.by, "times": len(alike)}
        self._write(facts, text, failed=bool(last.problem), redacted=redacted)

    def record_step(self, what: str, by: str, text: str, *, failed: bool = False) -> None:
        """Records a step of a change that takes a while, such as the end of a file transfer.

        Args:
            what: What is done.
            by: Who asks for it.
            text: The whole line.
            failed: Whether it has failed.
        """
        self._write({"what": what, "by": by, "times": 1}, text, failed=failed)

    def _write(self, facts: dict[str, Any], text: str, *, failed: bool, redacted: str = "") -> None:
        self._log.notice(text, failed=failed, redacted=redacted)
        self._publish(new_event("change", **facts, failed=failed, text=redacted or text))

    def close(self) -> None:
        """Records the changes that are still waiting."""
        for batch in self._batches.values():
            batch.close()


def _between(alike: Sequence[Change]) -> str:
    """Where the values were meanwhile, if they are numbers beyond the first and the last one."""
    ends = _numbers((alike[0].before or alike[0].after, alike[-1].after))
    values = _numbers(change.after for change in alike)
    if not ends or not values or (min(ends) <= min(values) and max(values) <= max(ends)):
        return ""
    return f" (between {min(*ends, *values):.15g} and {max(*ends, *values):.15g})"


def _numbers(texts: Iterable[str]) -> list[float]:
    """The numbers; none if one of the texts is no number."""
    try:
        return [float(text) for text in texts]
    except ValueError:
        return []


def shown(data: bytes) -> str:
    """Bytes in a line; of long ones the beginning, the length and the SHA-256."""
    if len(data) <= SHOWN:
        return data.hex(" ") or "nothing"
    return f"{data[:SHOWN].hex(' ')} ... ({content(data)})"


def content(data: bytes | bytearray) -> str:
    """Length and SHA-256 of a content, which identify it."""
    return f"{len(data)} bytes, SHA-256 {hashlib.sha256(data).hexdigest()}"
