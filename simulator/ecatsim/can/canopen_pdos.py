"""PDOs of a CANopen slave (CiA 301): communication parameters, mapping, and when they are sent."""

from __future__ import annotations

from collections.abc import Sequence

from ecatd.etg import error_codes
from ecatd.etg.datatypes import DataType
from ecatd.etg.error_codes import abort_error
from ecatd.etg.pdo import Entry, Pdo

from ..slave.objects import Access, Dictionary, ObjectCode, Variable
from ..slave.pdo_objects import follow_list_procedure, mapping_value
from ..slave.process_image import ProcessImage
from .frame import CanFrame

_U8, _U16, _U32 = DataType.UNSIGNED8, DataType.UNSIGNED16, DataType.UNSIGNED32
_INVALID, _NO_REMOTE = 1 << 31, 1 << 30
_MAX_BITS, _MAX_ENTRIES = 64, 8
_PREDEFINED = 4  # PDOs of each direction in the connection set of CiA 301
_MAX_SYNCHRONOUS = 240
_COMMUNICATION_STRUCTURE, _MAPPING_STRUCTURE = 0x20, 0x21


class _Pdo:
    """A PDO and its two objects.

    Args:
        objects: The dictionary.
        number: Number of the PDO, 1 first.
        node_id: Number of the node.
        mapped: The mapped objects: index and subindex.
        kind: Transmission type.
    """

    first_identifier: int
    first_object: int
    right: Access

    def __init__(
        self,
        objects: Dictionary,
        number: int,
        node_id: int,
        mapped: Sequence[tuple[int, int]],
        kind: int = 255,
    ) -> None:
        self._objects = objects
        self._index = self.first_object + number - 1
        self._mapping = self._index + 0x200
        identifier = self.first_identifier + (number - 1) * 0x100 + node_id
        if number > _PREDEFINED:
            identifier = _INVALID
        objects.record(
            self._index,
            f"{self.title} {number} communication parameter",
            [self._parameter(*row) for row in self._parameters(identifier, kind)],
            type=_COMMUNICATION_STRUCTURE,
        )
        values = [mapping_value(self._entry(index, subindex)) for index, subindex in mapped]
        item = objects.array(
            self._mapping,
            f"{self.title} {number} mapping parameter",
            _U32,
            values + [0] * (_MAX_ENTRIES - len(values)),
            Access.RW,
        )
        item.code, item.type = ObjectCode.RECORD, _MAPPING_STRUCTURE
        item.entries[0].value = len(values)
        follow_list_procedure(item, self._check_mapped, self._check_mapping)
        self._image: ProcessImage | None = None
        self._image_of: list[int] = []

    @property
    def title(self) -> str:
        """RPDO or TPDO."""
        return "RPDO" if self.right == Access.RX_PDO else "TPDO"

    def _parameters(self, identifier: int, kind: int) -> list[tuple[int, str, DataType, int]]:
        return [(1, "COB-ID", _U32, identifier), (2, "Transmission type", _U8, kind)]

    def _parameter(self, subindex: int, name: str, kind: DataType, value: int) -> Variable:
        return Variable(self._index, subindex, name, kind, 0, Access.RW, value)

    def _number(self, subindex: int) -> int:
        value = self._objects[self._index, subindex].value
        assert isinstance(value, int)
        return value

    @property
    def identifier(self) -> int | None:
        """Its identifier; None: it is switched off."""
        value = self._number(1)
        return None if value & _INVALID else value & 0x7FF

    @property
    def synchronous(self) -> bool:
        """Whether it goes by SYNC."""
        return self._number(2) <= _MAX_SYNCHRONOUS

    @property
    def image(self) -> ProcessImage:
        """Its data, with the present mapping."""
        entries = self._objects.object(self._mapping).entries
        count = entries[0].value
        assert isinstance(count, int)
        values = [int(entries[i].value) for i in range(1, count + 1)]
        if self._image is None or values != self._image_of:
            mapped = [self._entry(value >> 16, value >> 8 & 0xFF) for value in values]
            self._image = ProcessImage([Pdo(self._mapping, "", 0, mapped)], self._objects)
            self._image_of = values
        return self._image

    def reset(self) -> None:
        """Begins anew."""

    # --- writes of the master --------------------------------------------------------------------

    def _entry(self, index: int, subindex: int) -> Entry:
        variable = self._objects[index, subindex]
        return Entry(index, subindex, variable.name, variable.type, variable.bits)

    def _check_mapped(self, value: int) -> None:
        variable = self._objects.entry(value >> 16, value >> 8 & 0xFF)
        if not variable.access & self.right or variable.bits != value & 0xFF:
            raise abort_error(error_codes.NOT_MAPPABLE)

    def _check_mapping(self, values: Sequence[int]) -> None:
        if sum(value & 0xFF for value in values) > _MAX_BITS:
            raise abort_error(error_codes.PDO_LENGTH)


class ReceivePdo(_Pdo):
    """An RPDO: data from a master."""

    first_identifier, first_object, right = 0x200, 0x1400, Access.RX_PDO
    _waiting: bytes | None = None

    def take(self, frame: CanFrame) -> None:
        """Takes a frame if it is this PDO; with a synchronous one, at the next SYNC."""
        if frame.id != self.identifier or frame.remote or len(frame.data) < self.image.size:
            return
        if self.synchronous:
            self._waiting = frame.data
        else:
            self.image.unpack(frame.data)

    def sync(self) -> None:
        """Makes the data count that came before SYNC."""
        if self._waiting is not None:
            self.image.unpack(self._waiting)
            self._waiting = None

    def reset(self) -> None:
        """Forgets data that wait for SYNC."""
        self._waiting = None


class TransmitPdo(_Pdo):
    """A TPDO: data for a master.

    With a transmission type of 1 to 240 it is sent with every n-th SYNC, with 0 if it has changed
    since the SYNC before. With 254 and 255 it is sent when it has changed, though not before the
    inhibit time is over, and at the latest when the event timer is.
    """

    first_identifier, first_object, right = 0x180, 0x1800, Access.TX_PDO

    def _parameters(self, identifier: int, kind: int) -> list[tuple[int, str, DataType, int]]:
        return [
            *super()._parameters(identifier | _NO_REMOTE, kind),
            (3, "Inhibit time", _U16, 0),
            (5, "Event timer", _U16, 0),
        ]

    def reset(self) -> None:
        """Has nothing sent yet."""
        self._sent: bytes | None = None
        self._sent_at = 0.0
        self._syncs = 0

    def due_at_sync(self) -> bool:
        """Whether it must be sent with the SYNC that has just come."""
        kind = self._number(2)
        if self.identifier is None or kind > _MAX_SYNCHRONOUS:
            return False
        self._syncs += 1
        if kind == 0:
            return self.image.pack() != self._sent
        if self._syncs < kind:
            return False
        self._syncs = 0
        return True

    def due(self, now: float) -> bool:
        """Whether it must be sent because of a change, or of the time."""
        if self.identifier is None or self.synchronous:
            return False
        since = now - self._sent_at
        if self._sent is not None and since < self._number(3) / 10_000:
            return False
        timer = self._number(5)
        return self.image.pack() != self._sent or bool(timer and since >= timer / 1000)

    def frame(self, now: float) -> CanFrame:
        """Returns the frame to be sent now."""
        self._sent = self.image.pack()
        self._sent_at = now
        return CanFrame(self.identifier or 0, self._sent)
