"""Requests of each kind that the daemon knows, so that no test leaves a kind out."""

from ecatd.base.errors import UsageError
from ecatd.operations.catalog import OPERATIONS
from ecatd.operations.operation import Operation
from ecatd.operations.query import to_query

VALUES: dict[str, tuple[object, ...]] = {
    "values": ({"3/0x7000:01": "1", "0/0x60FF:00": None},),
    "writer": ("page", "all", None),
    "address": (0x0130, 0x0420, "192.168.7.2/24", None),
    "boot": (False,),
    "buckets": (False, True),
    "by": ("'ecatctl' (pid 7, uid 0)", ""),
    "complete": (False, True),
    "count": (8, 128),
    "data": (b"\xe8\x03", None),
    "digest": (64 * "0",),
    "dns": (None, "none"),
    "drive": (0, 1),
    "file": ("firmware", "log.txt"),
    "hz": (10.0, 0.5),
    "gateway": (None, "192.168.7.1"),
    "idn": (17, 0x8064),
    "index": (0x6060, 0x1018, 0x1C12),
    "level": ("debug", "info"),
    "mac": (None, "02:00:00:00:00:01"),
    "more": (False, True),
    "name": (None, "drive"),
    "offset": (0, 5),
    "only_find": (False, True),
    "part": ("mailbox", None),
    "password": (0, 7),
    "pattern": ("*", "4/*"),
    "position": (0, 100),
    "ring": ("cycle", "control"),
    "since": (0, 17),
    "size": (2, 5),
    "slave": (0, "EK1100", "7/Ana. Eingang? ä*", "all", "3", None),
    "state": ("OP", "PREOP", "SAFEOP"),
    "subindex": (0, 1),
    "transfer": (1 << 40, 1),
    "user": ("anna",),
    "value": (None, "-3"),
    "word": (0, 0x40),
    "write": (True, False),
}
"""Values of each field of a request; it takes those of a type that it may have."""
USUAL = (1, 0.5, True, b"x", "x", None)
"""Values of fields that are not above."""


def _samples(kind: type[Operation]) -> list[Operation]:
    fitting = {
        name: [value for value in VALUES.get(name, USUAL) if _type(value) in field.types]
        for name, field in kind.fields.items()
    }
    found = []
    for number in range(max(map(len, fitting.values()), default=1)):
        whole = {name: values[number % len(values)] for name, values in fitting.items()}
        for values in (whole, {name: whole[name] for name in kind.needed}):
            try:
                request = kind(**values)
            except UsageError:  # fields that contradict each other
                continue
            if request not in found:
                found.append(request)
    assert found, f"there is no request {kind.op} with these values"
    return found


def _type(value: object) -> str:
    return "None" if value is None else type(value).__name__


SAMPLES = [request for kind in OPERATIONS.values() for request in _samples(kind)]
KEYS = sorted({"/".join(to_query(request).key) for request in SAMPLES} - {"as/anna/ro/rights"})
"""Keys below a bus that somebody on its machine may use."""
