"""Process data of a device: which PDOs are mapped, and how they reach the sync managers."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from ecatd.model.pdo import Pdo

from ..core import Area, Segment
from .objects import Dictionary
from .pdo_objects import ProcessDataObjects
from .process_image import ProcessImage
from .sii import SmType, SyncManager
from .state_machine import AlCode, RefusedError
from .sync_managers import channels_of, check_process_data


class ProcessData:
    """Both directions of the process data of one device.

    Args:
        objects: The dictionary, which gets the objects of the PDOs.
        rx_pdos: RxPDOs (outputs).
        tx_pdos: TxPDOs (inputs).
        settings: The sync managers.
        assignment: Whether a master may write the assignment.
        mapping: Indices of the PDOs whose mapping a master may write.
        limits: Bytes of outputs and inputs that a mapping may reach.

    Attributes:
        settings: The sync managers.
        outputs: The outputs as they are mapped now.
        inputs: The inputs as they are mapped now.
        at: Where they begin in the images of the segment.
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
        """Those of a kind; a device without one has an empty assignment for the usual one."""
        others = {SmType.OUTPUTS, SmType.INPUTS} - {kind}
        free = usual >= len(self.settings) or self.settings[usual].type not in others
        return channels_of(self.settings, kind) or [usual] * free

    @property
    def room(self) -> tuple[int, int]:
        """Bytes that the outputs and the inputs take at most, however they are mapped."""
        return self._rx.room, self._tx.room

    def rebuild(self) -> None:
        """Takes over assignment and mapping.

        Raises:
            RefusedError: There are more process data than the device has room for.
        """
        outputs = ProcessImage(self._rx.pdos, self._objects)
        inputs = ProcessImage(self._tx.pdos, self._objects)
        if outputs.size > self._rx.room:
            raise RefusedError(AlCode.OUTPUT_MAPPING)
        if inputs.size > self._tx.room:
            raise RefusedError(AlCode.INPUT_MAPPING)
        self.outputs, self.inputs = outputs, inputs

    def check(self, segment: Segment, position: int) -> None:
        """Checks the sync managers that the master set.

        Raises:
            RefusedError: They do not hold exactly the mapped PDOs.
        """
        areas = (*self.outputs.areas, *self.inputs.areas)
        sizes = {area.number: area.size for area in areas}
        check_process_data(segment, position, self.settings, sizes)

    def start(self, segment: Segment, position: int) -> None:
        """Connects the process data with the images of the segment.

        What lies in registers comes from the slave controller itself.
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
        """Closes or opens the process data channels to the master."""
        for kind in (SmType.OUTPUTS, SmType.INPUTS):
            for channel in channels_of(self.settings, kind):
                if not self.settings[channel].virtual:
                    segment.lock_sync_manager(position, channel, locked)
