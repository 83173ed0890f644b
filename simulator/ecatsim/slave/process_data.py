"""Process data of a device: which PDOs are mapped, and how they reach the sync managers."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from ecatd.model.bus import Pdo

from ..core import ProcessDataMap, Segment
from . import sync_managers
from .objects import Dictionary
from .pdo_objects import ProcessDataObjects
from .process_image import ProcessImage
from .sii import Mailbox, SmType, SyncManager
from .state_machine import AlCode, RefusedError


class ProcessData:
    """Both directions of the process data of one device.

    Args:
        objects: The dictionary, which gets the objects of the PDOs.
        rx_pdos: RxPDOs (outputs).
        tx_pdos: TxPDOs (inputs).
        assignment: Whether a master may write the assignment.
        mapping: Indices of the PDOs whose mapping a master may write.
        limits: Bytes of outputs and inputs that a mapping may reach.

    Attributes:
        outputs: The outputs as they are mapped now.
        inputs: The inputs as they are mapped now.
        settings: The sync managers.
    """

    def __init__(
        self,
        objects: Dictionary,
        rx_pdos: Sequence[Pdo],
        tx_pdos: Sequence[Pdo],
        *,
        assignment: bool,
        mapping: Collection[int],
        limits: tuple[int, int],
    ) -> None:
        self._objects = objects
        self._rx, self._tx = (
            ProcessDataObjects(
                objects,
                pdos,
                outputs=outputs,
                assignment=assignment,
                mapping=mapping,
                limit=limit,
            )
            for pdos, outputs, limit in ((rx_pdos, True, limits[0]), (tx_pdos, False, limits[1]))
        )
        self.settings: Sequence[SyncManager] = ()
        self.at = (0, 0)

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

    def set_up(self, settings: Sequence[SyncManager] | None, mailbox: Mailbox | None) -> None:
        """Takes the sync managers, or derives them from the default PDOs."""
        self.settings = (
            sync_managers.derive(mailbox, self.outputs.size, self.inputs.size, self._rx.room)
            if settings is None
            else list(settings)
        )

    def check(self, segment: Segment, position: int) -> None:
        """Checks the sync managers that the master set.

        Raises:
            RefusedError: They do not hold exactly the mapped PDOs.
        """
        sizes = self.outputs.size, self.inputs.size
        sync_managers.check_process_data(segment, position, self.settings, *sizes)

    def start(self, segment: Segment, position: int) -> None:
        """Connects the process data with the images of the segment."""
        # Several sync managers of a direction follow each other in memory.
        starts = {sm.type: sm.start for sm in reversed(self.settings)}
        where = ProcessDataMap(
            starts.get(SmType.OUTPUTS, 0),
            self.outputs.size,
            self.at[0],
            starts.get(SmType.INPUTS, 0),
            self.inputs.size,
            self.at[1],
        )
        segment.map(position, where)

    def lock(self, segment: Segment, position: int, locked: bool) -> None:
        """Closes or opens the process data channels to the master."""
        for kind in (SmType.OUTPUTS, SmType.INPUTS):
            channel = sync_managers.channel_of(self.settings, kind)
            if channel is not None:
                segment.lock_sync_manager(position, channel, locked)
