"""The slaves of a bus as a tree: each slave is behind the one at which it is plugged in."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from ecatd.description.cables import BAD, STRAINED, LinkVerdict
from ecatd.etg.port_errors import LinkErrors


@dataclass(slots=True)
class Node:
    """A slave in the tree."""

    position: int  #: Its position.
    name: str  #: Its name, or names.
    state: str  #: Its AL state in a word; empty if it does not answer.
    #: Propagation delay from the reference clock; None if it has no clock, or if clocks are not
    #: used.
    delay_ns: int | None
    #: The port of the slave before it at which it is plugged in; None at the master, or if it is
    #: not known where it is plugged in.
    port: int | None = None
    known: bool = False  #: Whether its place is known: it answers, and a link leads to it.
    #: The errors on its link to the slave before it; None for none.
    errors: LinkErrors | None = None
    #: The verdict on that link; None if it is not known which one that is.
    cable: LinkVerdict | None = None
    #: Errors at ports of it that lead nowhere now: the number of the port, and the errors.
    loose: list[tuple[int, LinkErrors]] = field(default_factory=list)
    #: The slaves that are plugged in at it, in the order of the frame.
    behind: list[Node] = field(default_factory=list)

    @property
    def error_text(self) -> str:
        """How its link is unless it is good, and the errors on it; empty for none."""
        errors = "" if self.errors is None else errors_text(self.errors)
        return ": ".join(filter(None, (self.fault, errors)))

    @property
    def fault(self) -> str:
        """How its link is in a word, such as `strained`; empty if it is good, or not known."""
        return self.cable.verdict if self.cable and self.cable.verdict in (STRAINED, BAD) else ""

    @property
    def all_errors(self) -> str:
        """As `error_text`, and the errors at ports that lead nowhere now."""
        loose = [f"port {port}: {errors_text(errors)}" for port, errors in self.loose]
        return "; ".join(filter(None, [self.error_text, *loose]))

    @property
    def delay_text(self) -> str:
        """The propagation delay in µs."""
        return "" if self.delay_ns is None else f"{self.delay_ns / 1000:.1f} µs"


def errors_text(errors: LinkErrors) -> str:
    """The errors on a link or at a port, in a few words."""
    # A damaged frame is often counted twice: as invalid, and by the physical layer.
    counts = (
        (max(errors.invalid, errors.physical), "error", "errors"),
        (errors.lost_links, "loss of the link", "losses of the link"),
    )
    return ", ".join(
        f"{count} {one if count == 1 else more}" for count, one, more in counts if count
    )


def rows(roots: list[Node]) -> Iterator[tuple[int, Node]]:
    """Each node with the depth of its branch.

    The last slave that is plugged in at another one goes on in the same branch, so a line of slaves
    is one column, however long it is.
    """
    waiting = [(0, node) for node in roots[::-1]]
    while waiting:
        depth, node = waiting.pop()
        yield depth, node
        if node.behind:
            *branches, last = node.behind
            waiting.append((depth, last))
            waiting += [(depth + 1, item) for item in branches[::-1]]
