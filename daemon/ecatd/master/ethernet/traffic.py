"""Carries Ethernet frames between this computer and the slaves with EoE, beside the cycle."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial

from ecatd.base.errors import EcatError, StateError
from ecatd.base.log import Log
from ecatd.base.tap import Tap
from ecatd.config.eoe import EoeConfig
from ecatd.description.bus import Bus, Slave
from ecatd.etg.eoe import FRAME_MAX, parse_interface
from ecatd.operations.ethernet import Ethernet, ReadEthernet
from ecatd.operations.handlers import handles

from ..emergencies import Emergency
from ..mailbox.conversation import run_conversation
from ..master import Master
from ..worker import Worker
from .switch import SlavePort, Switch

_BUSY_S = 0.5
"""Seconds after the last frame for which a slave is asked again and again for the next one. After
that, `watch/mailboxes.py` finds its frames."""
_PAUSE_S = 0.002
"""Seconds between two such questions."""
_AT_ONCE = 32
"""Most frames of this computer that are read in a row, so that other work gets its turn."""
_RETRY_S = 10.0
"""Seconds after which an interface that could not be made is tried again."""
_SILENT_S = 1.0
"""Seconds for which a slave is left alone that has not answered."""


class EthernetTraffic:
    """The switch with its ports: 0 is this computer, the others are slaves.

    Without a configured interface nothing is carried.

    Args:
        config: What is configured about the interface.
        bus: The bus.
        master: The master.
        worker: The worker on which slaves are asked.
        note: Called with each emergency that a slave sends meanwhile.
        log: The log.
    """

    def __init__(
        self,
        config: EoeConfig,
        bus: Bus,
        master: Master,
        worker: Worker,
        note: Callable[[Emergency], None],
        log: Log,
    ) -> None:
        self._config = config
        self._slaves = [slave for slave in bus.slaves if slave.eoe]
        self._master = master
        self._worker = worker
        self._note = note
        self._log = log.of("mailbox")
        self._loop = asyncio.get_running_loop()
        self._tap: Tap | None = None
        self._problem = ""
        self._sent = self._received = self._dropped = 0
        self._work = [asyncio.Event() for _ in self._slaves]
        self._ports: list[SlavePort] = []
        self._switch = Switch([self._to_computer])
        if config.interface:
            self._ports = [
                SlavePort(
                    master.coe(slave.position).queue,
                    partial(self._on_loop, self._forward, number),
                    partial(self._on_loop, work.set),
                )
                for number, (slave, work) in enumerate(
                    zip(self._slaves, self._work, strict=True), 1
                )
            ]
            self._switch = Switch([self._to_computer, *(port.send for port in self._ports)])

    @handles(ReadEthernet)
    def describe(self, _: ReadEthernet) -> Ethernet:
        """The interface and the ports, with what went through them."""
        ports = enumerate(zip(self._slaves, self._ports, strict=False), 1)
        return {
            "interface": self._config.interface,
            "address": self._config.address,
            "problem": self._problem,
            "sent": self._sent,
            "received": self._received,
            "dropped": self._dropped,
            "slaves": [
                {
                    "slave": slave.position,
                    "name": slave.display_name,
                    "sent": port.sent,
                    "received": port.received,
                    "dropped": port.dropped,
                    "lost": port.lost,
                    "macs": self._switch.addresses(number),
                }
                for number, (slave, port) in ports
            ]
            or [{"slave": slave.position, "name": slave.display_name} for slave in self._slaves],
        }

    async def run(self) -> None:
        """Carries frames until it is cancelled."""
        if not self._config.interface:
            return
        if not self._slaves:
            self._log.warning(
                f"[eoe] asks for interface {self._config.interface}, but no slave has EoE"
            )
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._keep_interface())
                for slave, port, work in zip(self._slaves, self._ports, self._work, strict=True):
                    group.create_task(self._carry(slave, port, work))
        finally:
            self._close()

    # --- this computer -------------------------------------------------------------------------

    async def _keep_interface(self) -> None:
        while True:
            if self._tap is None:
                self._open()
            await asyncio.sleep(_RETRY_S)

    def _open(self) -> None:
        try:
            self._tap = tap = Tap(
                self._config.interface,
                parse_interface(self._config.address) if self._config.address else None,
            )
        except StateError as error:
            if not self._problem:
                self._log.warning(f"{error}; ecatd tries it again every {_RETRY_S:g} s")
            self._problem = str(error)
            return
        self._problem = ""
        self._loop.add_reader(tap, self._read, tap)
        count = len(self._slaves)
        self._log.info(f"interface {tap.name} leads to {count} slave{'s' * (count != 1)} with EoE")

    def _close(self) -> None:
        if self._tap is not None:
            self._loop.remove_reader(self._tap)
            self._tap.close()
            self._tap = None

    def _read(self, tap: Tap) -> None:
        try:
            for _ in range(_AT_ONCE):
                if (frame := tap.read()) is None:
                    return
                if len(frame) > FRAME_MAX:  # somebody has set a larger MTU
                    self._dropped += 1
                    continue
                self._received += 1
                self._switch.forward(frame, 0)
        except StateError as error:
            self._problem = str(error)
            self._log.warning(f"{error}; ecatd tries every {_RETRY_S:g} s to make it again")
            self._close()

    def _to_computer(self, frame: bytes) -> None:
        tap = self._tap
        if tap is not None and tap.write(frame):
            self._sent += 1
        else:
            self._dropped += 1

    # --- slaves --------------------------------------------------------------------------------

    def _on_loop(self, call: Callable[..., object], *arguments: object) -> None:
        self._loop.call_soon_threadsafe(call, *arguments)

    def _forward(self, number: int, frame: bytes) -> None:
        self._switch.forward(frame, number)

    async def _carry(self, slave: Slave, port: SlavePort, work: asyncio.Event) -> None:
        """Exchanges frames with a slave whenever there are any."""
        failed: type[EcatError] | None = None  # the last exchange, and how
        while True:
            await work.wait()
            until = self._loop.time() + _BUSY_S
            while self._loop.time() < until:
                work.clear()
                try:
                    moved = await self._exchange(slave, port)
                except EcatError as error:
                    port.clear()
                    if type(error) is not failed:
                        failed = type(error)
                        self._log.warning(
                            f"{slave.label} gets no Ethernet frames: {error}",
                            slaves=[slave.position],
                        )
                    await asyncio.sleep(_SILENT_S)
                    continue
                except Exception as error:  # the bus must not end because of it
                    port.clear()
                    self._log.error(f"defect in ecatd while carrying Ethernet frames: {error!r}")
                    await asyncio.sleep(_SILENT_S)
                    continue
                if moved:
                    if failed:
                        text = f"{slave.label} gets Ethernet frames again"
                        self._log.info(text, slaves=[slave.position])
                    failed = None
                    until = self._loop.time() + _BUSY_S
                elif not work.is_set():
                    await asyncio.sleep(_PAUSE_S)

    async def _exchange(self, slave: Slave, port: SlavePort) -> bool:
        coe = self._master.coe(slave.position)
        conversation = port.exchange(coe)
        moved = await self._worker.request(run_conversation(self._master.registers, conversation))
        for code, register in coe.emergencies:
            self._note((slave, code, register))
        return moved
