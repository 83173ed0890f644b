"""Reports what the configuration has of each part of an ENI file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class Remark:
    """A part of the file that the configuration does not have.

    Attributes:
        line: Line in the file.
        slave: Position of the slave; None if it is about all slaves.
        text: The part, and why it was left out.
    """

    line: int
    slave: int | None
    text: str


@dataclass(slots=True)
class Report:
    """Reports what the configuration has of each part of an ENI file.

    Attributes:
        taken: By position, what the configuration has of a slave, in words.
        ours: What ecatd does in its own way, and how often the file is about it.
        unsupported: The parts that were left out, although they may matter.
    """

    taken: dict[int, list[str]] = field(default_factory=dict)
    ours: Counter[str] = field(default_factory=Counter)
    unsupported: list[Remark] = field(default_factory=list)

    def take(self, position: int, what: str) -> None:
        """Records a part of a slave that the configuration has."""
        self.taken.setdefault(position, []).append(what)

    def leave(self, line: int, slave: int | None, text: str) -> None:
        """Records a part that was left out."""
        self.unsupported.append(Remark(line, slave, text))

    def lines(self, path: str, labels: dict[int, str]) -> Iterator[str]:
        """The report for people.

        Args:
            path: The file.
            labels: The slaves as messages name them, by position.
        """
        yield "taken:"
        for position, parts in sorted(self.taken.items()):
            yield f"  {labels[position]}: {', '.join(parts)}"
        if +self.ours:
            yield "ecatd does this in its own way:"
        for what, count in (+self.ours).items():
            yield f"  {what} ({count})"
        yield "not taken:" if self.unsupported else "not taken: nothing else"
        for remark in self.unsupported:
            slave = "" if remark.slave is None else f"{labels[remark.slave]}: "
            yield f"  {path}:{remark.line}: {slave}{remark.text}"

    def to_dict(self) -> dict[str, Any]:
        """The report for programs."""
        return {
            "taken": [{"slave": n, "what": what} for n, what in sorted(self.taken.items())],
            "ours": [{"what": what, "count": count} for what, count in (+self.ours).items()],
            "unsupported": [
                {"line": remark.line, "slave": remark.slave, "text": remark.text}
                for remark in self.unsupported
            ],
        }
