"""The client that programs use."""

from __future__ import annotations

import ctypes
from collections import defaultdict
from collections.abc import AsyncIterator, Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, overload
from weakref import WeakSet

from ecatd import shm
from ecatd.model.al import AlState
from ecatd.model.errors import EcatError, UnreachableError
from ecatd.shm import Direction

from .claims import Claim
from .connection import PADDING, text_of
from .group import SignalGroup
from .handle import Handle
from .info import OutputInfo, Owner
from .requests import Request
from .signals import Signal, make
from .structs import QUICK, OutputStruct

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from .cycles import CycleWaiter

_LOOK = 0.02
"""Seconds between two looks for a daemon that has gone, in asyncio."""


class Client(Handle):
    """A connection to one bus.

    ```python
    with Client("ecat0") as bus:
        velocity = bus.signal("0/Velocity actual value")
        target = bus.signal(0, 0x60FF)
        with bus.claim(0, lease=0.2):
            while velocity.value < 1000:
                bus.wait()
                bus.sample()
                target.value = 1000
                bus.commit()
    ```

    Reading never waits and enters no kernel; any number of clients can read. When the daemon is
    started again, reading goes on by itself as soon as it is back; outputs must be claimed again.
    A client belongs to one thread at a time: open one for each.

    Args:
        bus: Name of the bus.

    Raises:
        UnreachableError: No daemon serves the bus.
        NotPermittedError: This user may not read it.
        StateError: The daemon has another version.
    """

    def __init__(self, bus: str = "ecat0") -> None:
        super().__init__(bus)
        self._images = self._find_images()
        self._signals: dict[int, Signal] = {}
        self._groups: WeakSet[SignalGroup] = WeakSet()
        self._abandoned: list[int] = []
        self._waiter: CycleWaiter | None = None
        self._seen = 0  # last cycle that asyncio waited for
        self._holders: dict[int, object] = {}  # outputs, and the claim that holds each of them
        self._of_slaves: dict[int, list[int]] = {}  # the entries of each; they never change

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""
        return self._memory is None

    def close(self) -> None:
        """Releases all claims and forgets the bus; who still waits in asyncio gets an error.

        Arrays of numpy keep the values of the last sample.

        Raises:
            UsageError: Another thread waits with this client.
        """
        super().close()
        if self._waiter is not None:
            self._waiter.close()
        for signal in self._signals.values():
            signal._detach()
        for group in self._groups:
            group._detach()
        self._images = []

    def _find_images(self) -> list[memoryview]:
        count = QUICK.ecat_domain_count(self._address)
        return [self._image(domain) for domain in range(count)]

    def _renew(self) -> None:
        self._images = self._find_images()
        self._holders.clear()
        self._seen = 0
        for number, signal in self._signals.items():
            info = self._signal_struct(number)
            signal._place(info, self._images[info.domain])
        for group in self._groups:
            group._prepare()

    # --- entries ----------------------------------------------------------------------------------

    @overload
    def signal(self, what: str, *, direction: Direction = Direction.ANY) -> Signal: ...

    @overload
    def signal(
        self,
        what: int,
        index: int | None = None,
        subindex: int = 0,
        direction: Direction = Direction.ANY,
    ) -> Signal: ...

    def signal(
        self,
        what: str | int,
        index: int | None = None,
        subindex: int = 0,
        direction: Direction = Direction.ANY,
    ) -> Signal:
        """An entry of the process image, always the same object for the same entry.

        Args:
            what: "slave/entry" as in `0/Statusword`, where the slave is its position, or its name
                if only one has it, and the entry its name, "PDO/entry" or `0x6041:00`; or the
                position of a slave, with `index`; or alone the number of the entry.
            index: Object index.
            subindex: Object subindex.
            direction: Which one, where the slave has the entry as input and as output.

        Raises:
            StateError: There is no such slave or entry, or the name is that of several.
        """
        if isinstance(what, str):
            number = self.lookup(what, direction)
        elif index is not None:
            number = self.bind(what, index, subindex, direction)
        else:
            number = what
        found = self._signals.get(number)
        if found is None:
            info = self._signal_struct(number)
            found = make(self, number, info, self._images[info.domain])
            self._signals[number] = found
        return found

    def signals(self, slave: int | None = None) -> list[Signal]:
        """All entries of the process image, or of one slave: outputs first, then inputs."""
        numbers: Iterable[int] = range(self._signal_count())
        if slave is not None:
            if not self._of_slaves:
                for number in numbers:
                    of_slave = self._signal_struct(number).slave
                    self._of_slaves.setdefault(of_slave, []).append(number)
            numbers = self._of_slaves.get(slave, [])
        return [self.signal(number) for number in numbers]

    def group(self, signals: Iterable[str | Signal]) -> SignalGroup:
        """Entries that are read at once, for programs that read many in each cycle."""
        made = SignalGroup(
            self, tuple(self.signal(s) if isinstance(s, str) else s for s in signals)
        )
        self._groups.add(made)
        return made

    def domain_array(self, number: int = 0) -> NDArray[np.void]:
        """The last sample of a domain as a structured array of numpy, without a copy.

        The array has no dimensions, cannot be written, and shows the new values after each sample;
        `.copy()` keeps them. Its fields have the names of `Signal.path`. Entries that are no whole
        bytes of a size that numpy knows lie together in fields of bytes such as `2/bits0`, for
        `numpy.unpackbits(…, bitorder="little")`. After a restart of the daemon ask for it again.

        Raises:
            UsageError: numpy is not installed, or there is no such domain.
        """
        from .arrays import view

        image = self._image(number)[:-PADDING]
        mine = [signal for signal in self.signals() if signal.domain == number]
        return view(mine, image)

    # --- outputs ----------------------------------------------------------------------------------

    def claim(self, what: int | str | Signal | Iterable[str | Signal], lease: float = 0.0) -> Claim:
        """Makes this client the owner of outputs, until `release` or the end of a `with` block.

        They stay at their safe values until the first commit after they were written.

        Args:
            what: The position of a slave, for all its outputs; or one output, or several. What
                this client owns already, goes on belonging to the claim that has got it.
            lease: Seconds without a sample or commit after which the outputs fall to their safe
                values, 0: the daemon's default. The longest of all claims counts for all.

        Raises:
            OwnedError: Another client owns one of them; the message names it. Nothing was claimed,
                and what this client owned before, it still owns.
            UsageError: One is an input, or there is nothing in a list.
        """
        return Claim(self, what, lease)

    def release(self, what: int | str | Signal | None = None) -> None:
        """Gives outputs back, of a slave or one; None: everything. They go to their safe values."""
        if what is None:
            QUICK.ecat_release_all(self._address)
            self._holders.clear()
            return
        if isinstance(what, int):
            self.release_slave(what)
            given = [signal.number for signal in self.signals(what)]
        else:
            given = [what.number if isinstance(what, Signal) else self.lookup(what)]
            self.release_entry(given[0])
        for number in given:
            self._holders.pop(number, None)

    def output(self, what: str | Signal) -> OutputInfo:
        """Who decides an output now, and since when."""
        signal = self.signal(what) if isinstance(what, str) else what
        raw = OutputStruct()
        self._check(QUICK.ecat_output(self._address, signal.number, ctypes.byref(raw)))
        return OutputInfo(
            signal,
            raw.owner if raw.owner >= 0 else None,
            bool(raw.owned),
            shm.Outputs(raw.state),
            shm.Reason(raw.reason),
            raw.since_cycle,
            raw.age,
            raw.pid,
            text_of(raw.program),
        )

    def claims(self) -> list[Owner]:
        """The clients that own outputs, and which."""
        owned: defaultdict[int, list[OutputInfo]] = defaultdict(list)
        for signal in self.signals():
            if signal.output and (info := self.output(signal)).owner is not None:
                owned[info.owner].append(info)
        return [
            Owner(
                slot,
                infos[0].pid,
                infos[0].program,
                infos[0].owned,
                tuple(info.signal for info in infos),
            )
            for slot, infos in sorted(owned.items())
        ]

    # --- asyncio ----------------------------------------------------------------------------------

    async def next_cycle(self, cycles: int = 1, timeout: float = 1.0) -> int:
        """Waits in asyncio for so many more cycles than at the last such wait, and samples.

        The event loop goes on meanwhile, and outputs that this client owns are kept: it samples
        while it waits, too.

        Args:
            cycles: How many.
            timeout: Seconds.

        Returns:
            Number of the last finished cycle.

        Raises:
            NoAnswerError: They did not come in time.
            UnreachableError: The daemon has ended (told within 100 ms), or is not back in time.
            StateError: The client was closed.
        """
        import asyncio

        from .cycles import CycleWaiter

        clock = asyncio.get_running_loop().time
        end = clock() + timeout
        while self._unsure:
            try:
                self.sample()
            except UnreachableError:
                if clock() + _LOOK > end:
                    raise
                await asyncio.sleep(_LOOK)
        if self._waiter is None:
            self._waiter = CycleWaiter(self.name)
        now = self.cycle
        target = (self._seen or now) + cycles
        try:
            if now >= target:
                await asyncio.sleep(0)  # who is always late must not stop all others
            while now < target:
                # Who owns outputs shows in each cycle that its event loop is alive.
                step = now + 1 if self._holders else target
                now = await self._waiter.wait(self._instance, step, end - clock())
                self.sample()
        except UnreachableError:
            self._unsure = True
            raise
        self._seen = now
        return now

    async def cycles(self, every: int = 1, timeout: float = 1.0) -> AsyncIterator[int]:
        """Iterates in asyncio over cycles, each with a fresh sample; see `next_cycle`.

        A body that takes longer than a cycle goes on with the newest one.
        """
        while True:
            yield await self.next_cycle(every, timeout)

    # --- requests ---------------------------------------------------------------------------------

    def sdo_upload(self, slave: int, index: int, subindex: int = 0) -> Request:
        """Starts to read an object of up to 512 bytes; never waits.

        At most four requests of a client run at the same time.

        Raises:
            StateError: Four are running already.
        """
        self._cancel_abandoned()
        return Request(self, self.sdo_start(slave, index, subindex))

    def sdo_download(self, slave: int, index: int, subindex: int, data: bytes) -> Request:
        """Starts to write an object of up to 512 bytes; never waits."""
        self._cancel_abandoned()
        return Request(self, self.sdo_start(slave, index, subindex, data))

    def state_request(self, slave: int, state: AlState) -> Request:
        """Starts to bring a slave to an AL state; never waits."""
        self._cancel_abandoned()
        return Request(self, self.state_start(slave, state))

    def sdo_read(self, slave: int, index: int, subindex: int = 0, timeout: float = 10.0) -> bytes:
        """Reads an object and waits for it, up to `timeout` seconds; see `Request.result`."""
        return self.sdo_upload(slave, index, subindex).result(timeout)

    def sdo_write(
        self, slave: int, index: int, subindex: int, data: bytes, timeout: float = 10.0
    ) -> None:
        """Writes an object and waits for it, up to `timeout` seconds; see `Request.result`."""
        self.sdo_download(slave, index, subindex, data).result(timeout)

    def _cancel_abandoned(self) -> None:
        """Frees the places of requests that nobody asks for any more."""
        while self._abandoned:
            with suppress(EcatError):
                self.cancel(self._abandoned.pop())
