"""Watches what the kernel says of the interfaces of a bus: MTU, speed, who else uses them."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence

from ecatd.base.errors import UnreachableError
from ecatd.base.log import Log
from ecatd.linux.interface_state import Remark, read_interfaces, remarks
from ecatd.operations.faults import Fault


class StateWatch:
    """The watch over the states of the interfaces of one bus.

    Args:
        interfaces: Their names.
        log: The log for remarks.
        tell: Publishes an event; gets its kind, and facts about it.

    Attributes:
        changed: Set if the kernel has told something since the last look.
    """

    def __init__(self, interfaces: Sequence[str], log: Log, tell: Callable[..., None]) -> None:
        self._interfaces = list(interfaces)
        self._log = log
        self._tell = tell
        self.changed = asyncio.Event()
        self.changed.set()
        self._known: dict[tuple[str, str], tuple[Remark, float]] = {}  # by interface and topic

    def note(self) -> None:
        """The kernel has told that something has changed."""
        self.changed.set()

    async def look(self) -> None:
        """Reads the states if something has changed, and tells what is wrong now, or no more."""
        if not self.changed.is_set():
            return
        self.changed.clear()
        # Some drivers ask their card, which takes a while.
        self.take(await asyncio.to_thread(self.read))

    def read(self) -> dict[tuple[str, str], Remark]:
        """What is not as it should be, by interface and topic."""
        try:
            states = read_interfaces(self._interfaces)
        except UnreachableError as error:
            self._log.debug(str(error))
            return {key: remark for key, (remark, _) in self._known.items()}
        return {(state.name, remark.topic): remark for state in states for remark in remarks(state)}

    def take(self, found: dict[tuple[str, str], Remark]) -> None:
        """Tells what has changed; on the event loop's thread."""
        for (interface, topic), remark in found.items():
            if (interface, topic) not in self._known:
                tell = self._log.error if remark.is_fault else self._log.warning
                tell(str(remark), "interface")
                self._publish(interface, topic, str(remark), over=False)
        for (interface, topic), (remark, _) in self._known.items():
            if (interface, topic) not in found:
                text = f"no longer so: {remark.text}"
                self._log.info(text, "interface")
                self._publish(interface, topic, text, over=True)
        now = time.time()
        before = self._known
        self._known = {
            key: (remark, before[key][1] if key in before else now) for key, remark in found.items()
        }

    def _publish(self, interface: str, topic: str, text: str, *, over: bool) -> None:
        self._tell("interface", interface=interface, topic=topic, over=over, text=text)

    @property
    def faults(self) -> list[Fault]:
        """What is wrong now."""
        return [
            Fault(topic, str(remark), since, interface=interface)
            for (interface, topic), (remark, since) in self._known.items()
            if remark.is_fault
        ]

    def explain(self, *topics: str) -> str:
        """Remarks of these topics, or all, which explain that frames get lost; empty for none."""
        return "; ".join(
            str(remark)
            for (_, topic), (remark, _) in self._known.items()
            if not topics or topic in topics
        )
