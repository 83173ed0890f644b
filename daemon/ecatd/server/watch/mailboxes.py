"""Polls the mailboxes of the slaves for messages that nobody has asked for.

They are emergencies, and Ethernet frames, which `master/ethernet` takes.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Sequence

from ecatd.base.batch import Batch
from ecatd.base.coroutine_steps import Steps
from ecatd.description.bus import Slave
from ecatd.etg.error_codes import emergency_text
from ecatd.master.emergencies import Emergency, log_emergencies
from ecatd.master.mailbox.conversation import run_conversations
from ecatd.master.mailbox.mailbox import MAILBOX_IN, has_mail
from ecatd.master.worker import Worker

from ..start.running_bus import RunningBus
from .reports import Reporter

_TOGETHER_S = 0.005
"""Looks that are due within so many seconds are one: they share frames."""
_MANAGER_SIZE = 8


class MailboxWatch:
    """The watch over the mailboxes of a bus.

    Args:
        running: The bus.
        worker: The worker on which slaves are asked.
        report: Reports emergencies.

    Attributes:
        emergencies: Takes emergencies, also those that come with answers to requests, and tells of
            them in batches.
    """

    def __init__(self, running: RunningBus, worker: Worker, report: Reporter) -> None:
        slaves = running.bus.slaves
        self._bus = running.bus
        self._polls = [running.config.settings_of(slave.position).poll_s for slave in slaves]
        self._slaves = {
            slave.position: slave
            for slave in slaves
            if (slave.coe or slave.eoe) and self._polls[slave.position]
        }
        self._due = dict.fromkeys(self._slaves, 0.0)
        self._master = running.master
        self._worker = worker
        self._report = report
        self.emergencies = Batch[Emergency](self._pass_on)

    def _pass_on(self, found: list[Emergency], left_out: int) -> None:
        log_emergencies(self._report.log, found, left_out)
        counts = Counter((slave.position, code, register) for slave, code, register in found)
        for (position, code, register), times in counts.items():
            label = self._bus.slaves[position].label
            text = f"{label} sent an emergency: {emergency_text(code, register)}"
            facts = {"slave": position, "code": code, "register": register, "times": times}
            severity = "" if code >> 8 else "info"  # 0x00xx: the error is over (CiA 301)
            self._report.publish("emergency", severity=severity, **facts, text=text)

    async def watch(self) -> None:
        """Looks for messages of each slave again and again."""
        while self._due:
            await asyncio.sleep(max(0.0, min(self._due.values()) - time.monotonic()))
            end = time.monotonic() + _TOGETHER_S
            slaves = [
                slave for position, slave in self._slaves.items() if self._due[position] < end
            ]
            for emergency in await self._worker.run_steps(self._collect(slaves)):
                self.emergencies.note(emergency)
            now = time.monotonic()
            self._due |= {slave.position: now + self._polls[slave.position] for slave in slaves}
        await asyncio.Event().wait()  # no slave has CoE or EoE, or nobody shall look

    def _collect(self, slaves: Sequence[Slave]) -> Steps[list[Emergency]]:
        """Reads the messages of those slaves with which nobody has a conversation now."""
        stations = [slave.address for slave in slaves]
        answers = self._master.registers.read_all(stations, MAILBOX_IN, _MANAGER_SIZE)
        ways = [
            (slave, self._master.coe(slave.position))
            for slave, answer in zip(slaves, answers, strict=True)
            if answer.wkc == 1 and has_mail(answer.data)
        ]
        ways = [(slave, way) for slave, way in ways if not len(way.queue)]
        if ways:
            # Errors are ignored here: whoever sends a request to the slave reports them.
            yield from run_conversations(self._master.registers, [way.collect() for _, way in ways])
        return [(slave, *found) for slave, way in ways for found in way.emergencies]

    def close(self) -> None:
        """Tells of the emergencies that are not told yet."""
        self.emergencies.close()
