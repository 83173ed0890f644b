"""All that is in the shared memory of a bus, as a document that also a damaged one has.

What does not make sense is left out, and told in `problems`: where it is, and what is wrong.
"""

from __future__ import annotations

import struct as binary
import time
from collections.abc import Callable
from enum import IntEnum
from typing import Any, TypeVar

from ecatd.base.errors import EcatError, NotPermittedError
from ecatd.base.namespaces import is_ours
from ecatd.etg.al import AL_ERROR_FLAG, AlState, al_state_text
from ecatd.etg.datatypes import DataType, is_signed, type_name
from ecatd.etg.scaling import to_physical
from ecatd.linux.process_state import look_at_process
from ecatd.operations.outputs import Output, OutputClient, Outputs

from . import contract as shm
from .checks import domain_faults, output_faults, signal_faults, slave_faults
from .reader import Page, Reader, SlotReader, opened, version

_T = TypeVar("_T")
_EXCHANGE = ("wkc", "wkc_state", "cycle")  # of `ecat_shm_page`
_SILENCE_NS = 80_000_000  # after which a cycle that does not end stands still (`shared_memory.c`)
_WHY_SAFE = {
    "start": "no client has owned it since the start",
    "released": "its owner has released it",
    "lapsed": "its owner gave no sign of life within its lease",
    "died": "the process of its owner has ended without a release",
    "gone": "another client has taken the slot of its owner, or a program has written over it",
    "stopping": "the daemon stops",
    "wkc": "slaves of its domain did not take part in the exchange",
    "source": "the input that is copied to it is not valid",
}
"""`ecat_reason` in words."""
_BY_HAND = "hand:"
"""How the name of a client begins that holds outputs for a user of Zenoh, whose name follows."""
_PROGRAM_MAX = 15
"""Characters of the name of a process (prctl(2), PR_SET_NAME)."""
_REALS = {(DataType.REAL32, 32): "<f", (DataType.REAL64, 64): "<d"}


def contents(bus: str) -> dict[str, Any]:
    """Everything in the shared memory of a bus on this machine, also after its daemon has died.

    Returns:
        A map, as `ecatctl shm --json` prints it (docs/command-line.md); `problems` are sentences.

    Raises:
        EcatError: There is nothing to show: no shared memory, no right to read it, another version,
            or a header that makes no sense.
    """
    with opened(bus) as shared:
        return Contents(shared, leftover=True).document()


class Contents:
    """Shared memory, taken apart; what is damaged goes to `problems`.

    Args:
        shared: The open shared memory.
        leftover: Also of shared memory whose daemon was killed.

    Attributes:
        problems: What is wrong, in the order in which it was found.
        head: `ecat_shm_header`.
        now_ns: CLOCK_MONOTONIC when they were read.

    Raises:
        EcatError: The header makes no sense.
    """

    def __init__(self, shared: Reader, *, leftover: bool = False) -> None:
        self._shared = shared
        self.problems: list[str] = []
        self.alive = shared.alive
        self.head = head = shared.header(leftover=leftover)
        self._domain_rows = self._table("domains")
        self._pages = [self._page(n, row) for n, row in enumerate(self._domain_rows)]
        self._slave_rows = self._table("slaves")
        self._status_rows = self._table("slave_status")
        self._signal_rows = self._table("signals")
        self._output_rows = self._table("outputs")
        self._slot_rows = self._table("slot_status")
        self.now_ns, self._now = time.monotonic_ns(), time.time()
        if head.cycle_time_ns == 0:
            self.problems.append("header: the cycle time is 0")

    def document(self) -> dict[str, Any]:
        """Everything, as JSON has it."""
        head = self.head
        return {
            **self.summary(),
            "bytes": self._shared.size,
            "layout": version(head.layout),
            "fingerprint": f"{head.fingerprint:016x}",
            "counts": {
                name: getattr(head, f"{name}_count")
                for name in ("slave", "signal", "domain", "slot")
            },
            "domains": self.domains(),
            "slaves": self.slaves(),
            "signals": self.signals(),
            "slots": self.slots(),
            "settings": self._settings(),
            "health": self._health(),
            "problems": self.problems,
        }

    def summary(self) -> dict[str, Any]:
        """Who runs the bus, and how it goes."""
        head = self.head
        return {
            "bus": self._shared.bus,
            "file": str(self._shared.path),
            "alive": self.alive,
            **_take(head, "state", "version", "pid"),
            "started": head.instance * 1e-9,
            "cycle_time_us": head.cycle_time_ns / 1000,
            "lease_us": head.lease_ns / 1000,
            "lease_max_us": head.lease_max_ns / 1000,
            "cycle": head.cycle,
            "age_us": self._age(head.cycle_end_ns),
        }

    # --- domains and slaves ---------------------------------------------------------------------

    def _page(self, number: int, row: Any) -> Page | None:
        fault = domain_faults(row, self.head)
        if fault:
            self._fault("domains", number, fault)
        page = self._try(lambda: self._shared.page(row))
        if page is not None and page.torn:
            self._fault("domains", number, "has a page that its writer left in the middle")
        return page

    def domains(self) -> list[dict[str, Any]]:
        """All domains, with their newest exchange."""
        made = []
        for number, (row, page) in enumerate(zip(self._domain_rows, self._pages, strict=True)):
            exchanged = page is not None and page.head.cycle > 0
            made.append(
                {
                    "number": number,
                    **_take(row, "name", "divider", "phase", "output_bytes", "wkc_expected"),
                    "input_bytes": max(0, row.image_bytes - row.output_bytes),
                    **(_take(page.head, *_EXCHANGE) if page else dict.fromkeys(_EXCHANGE)),
                    "age_us": self._age(page.head.time_ns) if page and exchanged else None,
                }
            )
        return made

    def slaves(self) -> list[dict[str, Any]]:
        """All slaves, with their AL state."""
        made = []
        for position, row in enumerate(self._slave_rows):
            fault = slave_faults(row, self.head, self._domain_rows)
            if fault:
                self._fault("slaves", position, fault)
            status = _at(self._status_rows, position)
            made.append(
                {
                    "position": position,
                    **_take(row, "name", "vendor", "product", "revision", "serial", "alias"),
                    **_take(row, "address", "domain", "output_bytes", "input_bytes", "dc_bits"),
                    "state": al_state_text(status.al_state) if status else None,
                    "al_code": status.al_code if status else None,
                }
            )
        return made

    # --- signals --------------------------------------------------------------------------------

    def signals(self, *, outputs: bool = False) -> list[dict[str, Any]]:
        """All entries of the process image, with their present values; or outputs only."""
        made = []
        for number, row in enumerate(self._signal_rows):
            if outputs and not row.output:
                continue
            fault = signal_faults(row, self.head, self._domain_rows)
            if fault:
                self._fault("signals", number, fault)
            made.append(self._signal(number, row, bool(fault)))
        return made

    def _signal(self, number: int, row: Any, damaged: bool) -> dict[str, Any]:
        page = None if damaged else _at(self._pages, row.domain)
        raw = None if page is None else decode(page.image, row)
        return {
            "number": number,
            "address": f"0x{row.index:04X}:{row.subindex:02X}",
            **_take(row, "slave", "name", "pdo", "pdo_name"),
            "output": bool(row.output),
            "type": type_name(row.type),
            **_take(row, "domain", "bit_offset", "bit_length", "unit"),
            "raw": raw,
            "value": None if raw is None else to_physical(raw, row.scale, row.offset),
            "scaled": (row.scale, row.offset) != (1.0, 0.0),
            "validity": "damaged" if page is None else self._validity(row, page),
            **(self._owner(number) if row.output else {}),
        }

    def _validity(self, row: Any, page: Page) -> str:
        """`ecat_validity()` of the C client."""
        status = _at(self._status_rows, row.slave)
        state = status.al_state if status else AlState.NONE
        needed = (AlState.OP,) if row.output else (AlState.OP, AlState.SAFEOP)
        if page.head.cycle == 0:
            found = shm.Validity.NEVER
        elif not self._delivers():
            found = shm.Validity.STALE
        elif page.head.wkc_state != shm.WkcState.COMPLETE or self._is_absent(row.slave, page):
            found = shm.Validity.INCOMPLETE
        elif state & AL_ERROR_FLAG or state not in needed:
            found = shm.Validity.NOT_OPERATIONAL
        else:
            found = shm.Validity.VALID
        return _word(found)

    def _is_absent(self, position: int, page: Page) -> bool:
        """Whether a slave is optional, and its group did not take part."""
        slave = _at(self._slave_rows, position)
        group = -1 if slave is None else slave.group
        return 0 <= group < shm.MAX_GROUPS and bool(page.head.absent >> group & 1)

    def _delivers(self) -> bool:
        limit = max(20_000_000, 5 * self.head.cycle_time_ns) + _SILENCE_NS
        return (
            self.alive
            and self.head.state != shm.BusState.STOPPED
            and self.now_ns - self.head.cycle_end_ns <= limit
        )

    def _owner(self, number: int) -> dict[str, Any]:
        row = _at(self._output_rows, number)
        if row is None:
            return dict.fromkeys(("owner", "state", "reason", "source", "since_cycle", "since_us"))
        fault = output_faults(row, self.head)
        if fault:
            self._fault("outputs", number, fault)
        return {
            "owner": row.owner if row.owner >= 0 and not fault else None,
            **_take(row, "state", "reason", "since_cycle"),
            "source": self._source(row) if row.state == shm.Outputs.COPIED else None,
            "since_us": self._age(row.since_ns) if row.since_ns else None,
        }

    def _source(self, row: Any) -> str | None:
        """The input that is copied to an output, such as "1/0x6000:01"."""
        source = _at(self._signal_rows, row.source)
        return source and f"{source.slave}/0x{source.index:04X}:{source.subindex:02X}"

    # --- clients --------------------------------------------------------------------------------

    def slots(self) -> list[OutputClient]:
        """Client slots that are or were in use."""
        try:
            with self._shared.slots(self.head) as out:
                count = out.header.slot_count
                if count < len(self._slot_rows):
                    self.problems.append(f".out: {count} slots, and {len(self._slot_rows)} states")
                made = [self._slot(n, row, out) for n, row in enumerate(self._slot_rows)]
        except EcatError as error:
            # A leftover may have no clients, and some users may not see them: both get the rest.
            if self.alive and not isinstance(error, NotPermittedError):
                self.problems.append(str(error))
            made = [self._slot(n, row, None) for n, row in enumerate(self._slot_rows)]
        return [slot for slot in made if slot is not None]

    def _slot(self, number: int, row: Any, out: SlotReader | None) -> OutputClient | None:
        bell = out.doorbell(number) if out else None
        client = out.slot(number) if out else None
        if row.state == shm.SlotState.FREE and (bell is None or bell.generation == 0):
            return None
        since = client.since_ns if client else 0
        name = shm.printable(client.program) if client else None
        user = hand_of(name or "")
        is_held = out.held(number) if out else None
        made: OutputClient = {
            "slot": number,
            "name": name,
            "pid": client.pid if client else None,
            "pid_is_ours": is_ours(client.pid_namespace) if client else None,
            "by_hand": user is not None,
            "user": user or "",
            **_take(row, "state", "reason", "lapses", "refused", "commit_cycle"),  # type: ignore[typeddict-item]
            "held": is_held,
            "process": "ended" if is_held is False else _process(client),
            "since": self._moment(self._age(since)) if 0 < since <= self.now_ns else None,
            "lease_ms": row.lease_ns / 1e6,
            "silent_ms": self._age(row.beat_ns) / 1000,
            "outputs": sum(output.owner == number for output in self._output_rows),
        }
        return made

    # --- the rest -------------------------------------------------------------------------------

    def _settings(self) -> list[dict[str, Any]]:
        return [
            {
                "setting": _word(shm.Setting(number)),
                "wanted": bool(row.wanted),
                "granted": bool(row.granted),
                **_take(row, "value", "error"),
            }
            for number, row in enumerate(self._table("settings"))
        ]

    def _health(self) -> dict[str, Any] | None:
        for row in self._table("health"):
            return {
                **_take(row, *(item.name for item in shm.COUNTERS)),
                **_take(row, "slaves_found", "al_status", "ring"),
                "links": [*_take(row, "link_first", "link_second").values()],
                "dc": _word(shm.DcState(row.dc_state)),
            }
        return None

    def _table(self, name: str) -> list[Any]:
        return self._try(lambda: self._shared.table(self.head, name)) or []

    def _try(self, part: Callable[[], _T]) -> _T | None:
        try:
            return part()
        except EcatError as error:
            self.problems.append(str(error))
            return None

    def _fault(self, table: str, number: int, fault: str) -> None:
        self.problems.append(f"{table}[{number}] {fault}")

    # --- outputs --------------------------------------------------------------------------------

    def outputs(self, *, names: bool) -> Outputs:
        """Who decides the values of all outputs; see `read_outputs`."""
        summary, owners = self.summary(), self.slots()
        places = {owner["slot"]: place for place, owner in enumerate(owners)}
        found: Outputs = {
            **{key: summary[key] for key in ("bus", "state", "cycle", "age_us")},  # type: ignore[typeddict-item]
            "owners": owners,
            "outputs": [
                self._output(row, places, names=names) for row in self.signals(outputs=True)
            ],
            "problems": self.problems,
        }
        if names:
            found["slaves"] = [
                {"position": position, "name": shm.printable(row.name)}
                for position, row in enumerate(self._slave_rows)
            ]
        return found

    def _output(self, row: dict[str, Any], places: dict[int, int], *, names: bool) -> Output:
        since_us, cause = row["since_us"], row["reason"] or ""
        is_safe = row["state"] == "safe" or cause == "source"
        made: Output = {
            "name": f"{row['slave']}/{row['address']}",
            **{key: row[key] for key in ("slave", "address", "state", "source")},  # type: ignore[typeddict-item]
            "owner": places.get(row["owner"], -1),
            "cause": cause,
            "reason": _WHY_SAFE.get(cause, cause) if is_safe else "",
            "since": self._moment(since_us) if row["since_cycle"] and since_us else None,
            "value": row["raw"],
        }
        if names:
            made["label"] = row["name"] or row["pdo_name"]
            made["physical"], made["unit"] = row["value"], row["unit"]
        return made

    def _age(self, then_ns: int) -> float:
        """Microseconds since a time of CLOCK_MONOTONIC; 0 for what is yet to come."""
        return float(max(0, self.now_ns - then_ns) / 1000)

    def _moment(self, age_us: float) -> float:
        """The Unix time so many microseconds ago."""
        return self._now - age_us * 1e-6


def _process(client: Any) -> str | None:
    """How the process of a client is, by its number."""
    if client is None or not client.pid or not is_ours(client.pid_namespace):
        return None
    found = look_at_process(client.pid, client.since_ns)
    return found.state if found else None


def hand_of(program: str) -> str | None:
    """The user for whom a client of this name holds outputs; None for any other client."""
    return program.removeprefix(_BY_HAND) if program.startswith(_BY_HAND) else None


def hand_name(user: str) -> str:
    """The name of a client that holds outputs for a user, as far as it has room."""
    data = f"{_BY_HAND}{user}".encode()[:_PROGRAM_MAX]
    return data.decode(errors="ignore")


def _at(rows: list[_T], number: int) -> _T | None:
    return rows[number] if number < len(rows) else None


def _take(row: Any, *names: str) -> dict[str, Any]:
    """Fields of a struct by their names; members of enumerations as words."""
    values = shm.values(row, *names)
    return {key: _word(item) if isinstance(item, IntEnum) else item for key, item in values.items()}


def _word(member: Any) -> str:
    return str(member.name).lower()


def decode(image: bytes, row: Any) -> int | float:
    """The raw value of an entry (`client_c/src/entries.h`).

    Args:
        image: The image of its domain.
        row: Its `ecat_shm_signal`.
    """
    first, bits = row.bit_offset // 8, row.bit_length
    end = (row.bit_offset + bits + 7) // 8
    raw: int = int.from_bytes(image[first:end], "little") >> row.bit_offset % 8 & (1 << bits) - 1
    if (row.type, bits) in _REALS:
        value: float = binary.unpack(_REALS[row.type, bits], raw.to_bytes(bits // 8, "little"))[0]
        return value
    if is_signed(row.type) and raw >> bits - 1:
        raw -= 1 << bits
    return raw


def read_outputs(bus: str, *, names: bool = False) -> Outputs:
    """Who decides the values of all outputs of a bus on this machine; asks nobody.

    Args:
        bus: Name of the bus.
        names: Whether to have names, units and physical values.

    Raises:
        EcatError: No daemon serves the bus, this user may not read it, or the shared memory is of
            another version or damaged beyond use.
    """
    with opened(bus) as shared:
        return Contents(shared).outputs(names=names)
