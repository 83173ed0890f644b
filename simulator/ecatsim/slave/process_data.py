"""The process data of a device: the mapped PDOs, and their connection to the sync managers."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from ecatd.etg.pdo import Pdo

from ..esc import Area, Segment
from .objects import Dictionary
from .pdo_objects import ProcessDataObjects
from .process_image import ProcessImage
from .sii import SmType, SyncManager
from .state_machine import AlCode, RefusedError
from .sync_managers import channels_of, check_process_data


class ProcessData:
    """The outputs and inputs of one device.

    Args:
        objects: The dictionary, to which the objects of the PDOs are added.
        rx_pdos: RxPDOs (outputs).
        tx_pdos: TxPDOs (inputs).
        settings: The sync managers.
        assignment: Whether a master may write the assignment.
        mapping: Indices of the PDOs whose mapping a master may write.
        limits: Largest sizes of outputs and inputs in bytes with a changed mapping.

    Attributes:
        settings: The sync managers.
        outputs: The outputs with their present mapping.
        inputs: The inputs with their present mapping.
        at: Offsets of outputs and inputs in the images of the segment.
    """

    def __init__(
        self,
        objects: Dictionary,
        rx_pdos: Sequence[Pdo],
        tx_pdos: Sequence[Pdo],
        settings: Sequence[SyncManager],
        *,
        assignment: bool,
        mapping: Collection[int],
        limits: tuple[int, int],
    ) -> None:
        self._objects = objects
        self.settings = settings
        self._rx, self._tx = (
            ProcessDataObjects(
                objects,
                pdos,
                outputs=kind == SmType.OUTPUTS,
                channels=self._channels(kind, usual),
                assignment=assignment,
                mapping=mapping,
                limit=limit,
            )
            for pdos, kind, usual, limit in (
                (rx_pdos, SmType.OUTPUTS, 2, limits[0]),
                (tx_pdos, SmType.INPUTS, 3, limits[1]),
            )
        )
        self.at = (0, 0)

    def _channels(self, kind: SmType, usual: int) -> list[int]:
        """Returns the channels of a kind.

        If there are none, this is the usual channel, for an assignment without PDOs, unless the
        other kind uses it.
        """
        others = {SmType.OUTPUTS, SmType.INPUTS} - {kind}
        free = usual >= len(self.settings) or self.settings[usual].type not in others
        return channels_of(self.settings, kind) or [usual] * free

    @property
    def room(self) -> tuple[int, int]:
        """Largest sizes of outputs and inputs in bytes, with any mapping."""
        return self._rx.room, self._tx.room

    def rebuild(self) -> None:
        """Applies the present assignment and mapping.

        Raises:
            RefusedError: The process data is larger than the device allows.
        """
        outputs = ProcessImage(self._rx.pdos, self._objects)
        inputs = ProcessImage(self._tx.pdos, self._objects)
        if outputs.size > self._rx.room:
            raise RefusedError(AlCode.OUTPUT_MAPPING)
        if inputs.size > self._tx.room:
            raise RefusedError(AlCode.INPUT_MAPPING)
        self.outputs, self.inputs = outputs, inputs

    def check(self, segment: Segment, position: int) -> None:
        """Checks the settings of the sync managers that the master has made.

        Raises:
            RefusedError: The sync managers do not hold exactly the mapped PDOs.
        """
        areas = (*self.outputs.areas, *self.inputs.areas)
        sizes = {area.number: area.size for area in areas}
        check_process_data(segment, position, self.settings, sizes)

    def start(self, segment: Segment, position: int) -> None:
        """Connects the process data to the images of the segment.

        Process data in registers is left to the slave controller itself.
        """
        areas = []
        for kind, image, at in (
            (SmType.OUTPUTS, self.outputs, self.at[0]),
            (SmType.INPUTS, self.inputs, self.at[1]),
        ):
            usable = channels_of(self.settings, kind)
            areas += [
                Area(
                    kind == SmType.OUTPUTS,
                    self.settings[area.number].start,
                    area.size,
                    at + area.offset,
                )
                for area in image.areas
                if area.number in usable and not self.settings[area.number].in_registers
            ]
        segment.map(position, areas)

    def lock(self, segment: Segment, position: int, locked: bool) -> None:
        """Locks or unlocks the process data channels for the master."""
        for kind in (SmType.OUTPUTS, SmType.INPUTS):
            for channel in channels_of(self.settings, kind):
                if not self.settings[channel].virtual:
                    segment.lock_sync_manager(position, channel, locked)
