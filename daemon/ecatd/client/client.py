"""The client that programs use."""

from __future__ import annotations

import ctypes
from collections import defaultdict
from collections.abc import AsyncIterator, Iterable, Sequence
from typing import TYPE_CHECKING, Self, SupportsIndex, overload
from weakref import WeakSet

from ecatd.base.errors import UnreachableError, UsageError
from ecatd.etg.al import AlState
from ecatd.shm import contract as shm
from ecatd.shm.contract import Direction

from .arguments import COUNT, INDEX, SUBINDEX, U32, refuse, seconds, text, whole
from .can import CanChannel
from .claims import Claim, Claims
from .connection import PADDING, Connection, text_of
from .group import SignalGroup, Summaries
from .info import DomainInfo, OutputInfo, Owner, SlaveInfo, Summary
from .requests import Request, Requests
from .signals import Signal, make
from .structs import QUICK, WAITING, CanInfoStruct, DomainStruct, SlaveStruct

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from .cycles import CycleWaiter
    from .drives import Drive, Drives

_LOOK = 0.02
"""Seconds between two checks for a daemon that has gone, in asyncio."""


class Client:
    """A client of one bus.

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

    Reading never waits and makes no system call; any number of clients can read. After a restart
    of the daemon, reading goes on as soon as it is back, but outputs must be claimed again. A
    client belongs to one thread at a time: open one for each thread.

    Args:
        bus: Name of the bus.

    Raises:
        UnreachableError: No daemon serves the bus.
        NotPermittedError: This user may not read it.
        StateError: The daemon has another version.
    """

    def __init__(self, bus: str = "ecat0") -> None:
        self._connection = Connection(bus, self._renew)
        self._claims = Claims(self._connection)
        self._requests = Requests(self._connection)
        self._signals: dict[int, Signal] = {}
        self._groups: WeakSet[SignalGroup] = WeakSet()
        self._drives: WeakSet[Drives] = WeakSet()
        self._waiter: CycleWaiter | None = None
        self._seen = 0  # last cycle that asyncio waited for
        self._of_slaves: dict[int, list[int]] = {}  # the entries of each slave; they never change

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""
        return self._connection.closed

    def close(self) -> None:
        """Releases all claims and closes the connection; waiting coroutines get an error.

        Arrays of numpy keep the values of the last sample.

        Raises:
            UsageError: Another thread waits with this client.
        """
        for drives in list(self._drives):
            drives.close()
        self._connection.close()
        if self._waiter is not None:
            self._waiter.close()
        for signal in self._signals.values():
            signal.detach()
        for group in self._groups:
            group.detach()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _renew(self) -> None:
        """The daemon was started again."""
        self._claims.holders.clear()
        self._seen = 0
        for signal in self._signals.values():
            signal.describe()
        for group in self._groups:
            group.prepare()

    # --- the bus ----------------------------------------------------------------------------------

    @property
    def name(self) -> str:
        """Name of the bus."""
        return self._connection.bus

    @property
    def fingerprint(self) -> int:
        """64 bits that identify slaves and mapping of the bus; meanings do not count."""
        return int(QUICK.ecat_fingerprint(self._connection.address))

    @property
    def instance(self) -> int:
        """64 bits that differ after each start of the daemon."""
        return int(QUICK.ecat_instance(self._connection.address))

    @property
    def cycle_time(self) -> float:
        """Base cycle in seconds."""
        return float(QUICK.ecat_cycle_time(self._connection.address))

    @property
    def cycle(self) -> int:
        """Number of the last finished cycle."""
        return self._connection.cycle

    def slaves(self) -> list[SlaveInfo]:
        """All slaves, with their present state."""
        connection, raw = self._connection, SlaveStruct()
        found = []
        for position in range(QUICK.ecat_slave_count(connection.address)):
            connection.check(QUICK.ecat_slave(connection.address, position, ctypes.byref(raw)))
            found.append(
                SlaveInfo(
                    position,
                    text_of(raw.name),
                    raw.vendor,
                    raw.product,
                    raw.revision,
                    raw.serial,
                    raw.al_state,
                    raw.al_code,
                    raw.domain,
                    bool(raw.optional),
                    bool(raw.absent),
                    bool(raw.has_outputs),
                    shm.Outputs(raw.outputs),
                    bool(raw.owned),
                )
            )
        return found

    def expect(self, position: int, vendor: int, product: int, revision: int = 0) -> None:
        """Raises `StateError` unless the slave at `position` is this one (revision 0: any)."""
        numbers = (
            whole("position", position),
            whole("vendor", vendor, U32),
            whole("product", product, U32),
            whole("revision", revision, U32),
        )
        self._connection.check(QUICK.ecat_expect(self._connection.address, *numbers))

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
        """Finds an entry of the process image; the same entry is always the same object.

        Args:
            what: One of three: a text "slave/entry" such as `0/Statusword`; with `index`, the
                position of a slave; or the number of the entry. In a text, the slave is its
                position, or its name if only one slave has it. The entry is its name, "PDO/entry",
                or its address such as `0x6041:00`.
            index: Object index.
            subindex: Object subindex.
            direction: Input or output, if the slave has the entry as both.

        Raises:
            StateError: There is no such slave or entry, or several have this name.
            UsageError: An argument has another type, or is out of range.
        """
        connection = self._connection
        if isinstance(what, str):
            if index is not None:
                raise UsageError("index goes with the position of a slave, not with a name")
            number = connection.lookup(what, whole("direction", direction))
        elif index is not None:
            address = (whole("index", index, INDEX), whole("subindex", subindex, SUBINDEX))
            place = (whole("what", what), *address, whole("direction", direction))
            number = connection.check(QUICK.ecat_bind(connection.address, *place))
        else:
            number = whole("what", what)
        found = self._signals.get(number)
        if found is None:
            found = self._signals[number] = make(connection, number)
        return found

    def signals(self, slave: int | None = None) -> list[Signal]:
        """All entries of the process image, or of one slave: outputs first, then inputs."""
        connection = self._connection
        numbers: Iterable[int] = range(QUICK.ecat_signal_count(connection.address))
        if slave is not None:
            slave = whole("slave", slave)
            if not self._of_slaves:
                for number in numbers:
                    of_slave = connection.signal(number).slave
                    self._of_slaves.setdefault(of_slave, []).append(number)
            numbers = self._of_slaves.get(slave, [])
        return [self.signal(number) for number in numbers]

    def group(self, signals: Iterable[str | Signal]) -> SignalGroup:
        """Entries that are read at once, for programs that read many in each cycle."""
        made = SignalGroup(self._connection, self._entries("signals", signals))
        self._groups.add(made)
        return made

    def _entry(self, name: str, what: object) -> Signal:
        if isinstance(what, str):
            return self.signal(what)
        if not isinstance(what, Signal):
            raise refuse(name, "an entry: a Signal, or a text such as '0/Statusword'", what)
        if what is not self._signals.get(what.number):
            raise UsageError(f"{name} is an entry of another client: {what!r}")
        return what

    def _entries(self, name: str, several: object) -> tuple[Signal, ...]:
        if isinstance(several, (str, bytes, Signal)) or not isinstance(several, Iterable):
            raise refuse(name, "several entries, such as ['0/Statusword']", several)
        return tuple(self._entry(f"an item of {name}", what) for what in several)

    def can(self, slave: int | str) -> CanChannel:
        """The CAN channel of a terminal.

        Args:
            slave: Position or name of the terminal.

        Raises:
            StateError: There is no such slave, or it has no CAN channel.
        """
        connection = self._connection
        if isinstance(slave, str):
            found = QUICK.ecat_find_name(connection.address, text("slave", slave))
            slave = connection.check(found)
        return CanChannel(connection, whole("slave", slave))

    def can_terminals(self) -> list[int]:
        """Positions of the terminals with a CAN channel."""
        connection, raw, found = self._connection, CanInfoStruct(), []
        for number in range(QUICK.ecat_can_count(connection.address)):
            connection.check(QUICK.ecat_can(connection.address, number, ctypes.byref(raw)))
            found.append(int(raw.slave))
        return found

    # --- drives -----------------------------------------------------------------------------------

    def drive(self, name: str | int, *, lease: float = 0.2) -> Drive:
        """An axis with the device profile CiA 402, which is claimed as long as its `with` lasts.

        Args:
            name: Name or position of its slave; "NAME/2" is the second axis of a drive.
            lease: Seconds without an exchange after which it stops as its safe outputs say.

        Raises:
            StateError: There is no such slave, or it is no drive.
        """
        return self.drives(name, lease=lease)[0]

    def drives(self, *names: str | int, lease: float = 0.2, together: bool = True) -> Drives:
        """Several axes; with `together`, all stop when one of them stops by itself."""
        from .drives import Drives

        made = Drives(self, names, lease=lease, together=together)
        self._drives.add(made)
        return made

    # --- the image --------------------------------------------------------------------------------

    def sample(self, domain: int | None = None) -> None:
        """Takes one consistent image of every domain. All reads until the next call use it.

        A sample also counts as the heartbeat that keeps this client's outputs.

        Args:
            domain: Sample only this domain; the last samples of the others stay.

        Raises:
            UnreachableError: The daemon delivers no new cycles; the last values stay readable.
            StateError: The daemon was started again, with another bus.
            UsageError: There is no such domain.
        """
        connection = self._connection
        if domain is None:
            connection.check_live(QUICK.ecat_sample(connection.address))
        else:
            number = whole("domain", domain)
            connection.check_live(QUICK.ecat_sample_domain(connection.address, number))

    def commit(self) -> None:
        """Publishes all staged outputs at once; they are sent with the next cycle.

        Raises:
            LeaseError: This client has lost its outputs; claim them again.
        """
        connection = self._connection
        connection.check(QUICK.ecat_commit(connection.address))

    def wait(self, cycles: int = 1, timeout: float = 1.0, domain: int | None = None) -> None:
        """Waits for the end of so many more cycles than at the last sample or wait.

        Args:
            cycles: How many.
            timeout: Seconds.
            domain: Count the exchanges of this one instead of cycles.

        Raises:
            NoAnswerError: They did not come in time.
            UnreachableError: The daemon has ended (reported within 100 ms), or is not back in time.
            UsageError: There is no such domain.
        """
        connection = self._connection
        cycles, timeout = whole("cycles", cycles), seconds("timeout", timeout)
        if domain is None:
            connection.wait_cycles(cycles, timeout)
        else:
            domain = whole("domain", domain)
            connection.wait(WAITING.ecat_wait_domain, "exchange", timeout, domain, cycles)

    def summarize(
        self, signals: Sequence[str | Signal], cycles: int, timeout: float = 1.0
    ) -> list[Summary]:
        """Waits for some cycles, and reads entries in each of them, so that no peak is lost.

        Other threads run meanwhile. It samples, as `sample` does.

        Args:
            signals: The entries.
            cycles: How many cycles.
            timeout: Seconds for which a cycle may be late.

        Raises:
            NoAnswerError: A cycle did not come in time.
            UnreachableError: The daemon has ended.
        """
        summaries = self.summaries(signals)
        return summaries.rows(summaries.take(cycles, timeout))

    def summaries(self, signals: Iterable[str | Signal]) -> Summaries:
        """Prepares entries for `summarize` again and again, without a gap between the rows."""
        return Summaries(self._connection, self._entries("signals", signals))

    def domain(self, number: int = 0) -> DomainInfo:
        """What is known about the last sample of a domain."""
        connection, raw = self._connection, DomainStruct()
        number = whole("number", number)
        connection.check(QUICK.ecat_domain(connection.address, number, ctypes.byref(raw)))
        return DomainInfo(
            text_of(raw.name),
            raw.divider,
            raw.cycle,
            raw.time_ns,
            raw.age,
            raw.wkc,
            raw.wkc_expected,
            shm.WkcState(raw.wkc_state),
        )

    def domain_array(self, number: int = 0) -> NDArray[np.void]:
        """The last sample of a domain as a structured array of numpy, without a copy.

        The array has no dimensions, cannot be written, and shows the new values after each sample;
        `.copy()` keeps them. Its fields have the names of `Signal.path`. Entries whose size no type
        of numpy has lie together in fields of bytes such as `2/bits0`; read them with
        `numpy.unpackbits(…, bitorder="little")`. After a restart of the daemon ask for it again.

        Raises:
            UsageError: numpy is not installed, or there is no such domain.
        """
        from .arrays import view

        number = whole("number", number)
        image = self._connection.image(number)[:-PADDING]
        mine = [signal for signal in self.signals() if signal.domain == number]
        return view(mine, image)

    # --- outputs ----------------------------------------------------------------------------------

    def claim(
        self, what: int | str | Signal | Iterable[str | Signal], *, lease: float = 0.0
    ) -> Claim:
        """Makes this client the owner of outputs until `Claim.release`, or the end of a `with`.

        They stay at their safe values until they are written and committed.

        Args:
            what: The position of a slave, for all its outputs; or one output, or several. An output
                that this client owns already stays with its first claim.
            lease: Seconds without a sample or commit after which the outputs take their safe
                values; 0: the daemon's default. The longest lease of all claims counts for all.

        Raises:
            OwnedError: Another client owns one of them; the message names it. Nothing was claimed,
                and this client still owns what it owned before.
            UsageError: One of them is an input, or the list is empty.
        """
        lease = seconds("lease", lease)
        if isinstance(what, SupportsIndex):
            slave = whole("what", what)
            outputs = tuple(signal for signal in self.signals(slave) if signal.output)
            return Claim(self._claims, slave, outputs, lease)
        one = isinstance(what, (str, Signal))
        entries = (self._entry("what", what),) if one else self._entries("what", what)
        if not entries:
            raise UsageError("there is nothing to claim: the list of outputs is empty")
        return Claim(self._claims, None, tuple(dict.fromkeys(entries)), lease)

    def output(self, what: str | Signal) -> OutputInfo:
        """Who controls an output now, and since when."""
        return self._claims.output(self._entry("what", what))

    def owners(self) -> list[Owner]:
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

        Meanwhile the event loop goes on. This client keeps its outputs, because it samples while it
        waits.

        Args:
            cycles: How many.
            timeout: Seconds.

        Returns:
            Number of the last finished cycle.

        Raises:
            NoAnswerError: They did not come in time.
            UnreachableError: The daemon has ended (reported within 100 ms), or is not back in time.
            StateError: The client was closed.
        """
        import asyncio

        from .cycles import CycleWaiter

        cycles, timeout = whole("cycles", cycles, COUNT), seconds("timeout", timeout)
        connection = self._connection
        clock = asyncio.get_running_loop().time
        end = clock() + timeout
        while connection.unsure:
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
                await asyncio.sleep(0)  # a task that is always late must let other tasks run
            while now < target:
                # An owner of outputs samples in each cycle, to show that its event loop is alive.
                step = now + 1 if self._claims.holders else target
                now = await self._waiter.wait(connection.instance, step, end - clock())
                self.sample()
        except UnreachableError:
            connection.unsure = True
            raise
        self._seen = now
        return now

    async def cycles(self, every: int = 1, timeout: float = 1.0) -> AsyncIterator[int]:
        """Iterates in asyncio over cycles, each with a fresh sample; see `next_cycle`.

        If the body takes longer than a cycle, the iteration goes on with the newest one.
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
        return self._requests.sdo(slave, index, subindex, None)

    def sdo_download(self, slave: int, index: int, subindex: int, data: bytes) -> Request:
        """Starts to write an object of up to 512 bytes; never waits."""
        return self._requests.sdo(slave, index, subindex, data)

    def request_state(self, slave: int, state: AlState) -> Request:
        """Starts to bring a slave to an AL state; never waits."""
        return self._requests.state(slave, state)
