"""Reads the modules of a modular device (ETG.5001), and writes the list of expected modules.

The PDOs and objects of such a device depend on the modules in its slots. Before SAFEOP it compares
the modules that the master expects (0xF030) with those that it has detected (0xF050).
"""

from __future__ import annotations

from collections.abc import Sequence

from ecatd.base.errors import SdoAbortError
from ecatd.description.bus import Module
from ecatd.description.modules import CONFIGURED, DETECTED, no_slots_text, other_modules
from ecatd.etg.error_codes import abort_error
from ecatd.master.mailbox.coe import Coe
from ecatd.master.mailbox.conversation import Conversation

from .object_access import RefusedError, ValueLists, write
from .scanned import Scanned, SlaveMailbox

_SLOTS_MAX = 255


class Modules(SlaveMailbox):
    """The modules of one slave. All methods are parts of a conversation."""

    def __init__(self, item: Scanned, coe: Coe) -> None:
        super().__init__(item, coe)
        self._lists = ValueLists(coe, item.slave.label, item.sii)

    def detected(self) -> Conversation[list[Module]]:
        """Reads the modules in the slots, slot 1 first; none for a device without slots.

        Raises:
            NoAnswerError: The slave does not answer.
            StateError: Its answers are malformed.
        """
        try:
            yield from self._coe.upload(DETECTED, 0, tries=1)  # most slaves have no such object
        except SdoAbortError:
            return []
        idents = yield from self._lists.read(DETECTED, 4, _SLOTS_MAX)
        return [Module(ident) for ident in idents]

    def write(self, wanted: Sequence[Module]) -> Conversation[None]:
        """Checks the modules in the slots, and writes the list of expected modules to the slave.

        Raises:
            RefusedError: The slave has other modules, or refuses the list.
            NoAnswerError: The slave does not answer.
            StateError: Its answers are malformed.
        """
        there = yield from self.detected()
        if there and (text := other_modules(wanted, there)):
            raise RefusedError(self._slave, text)
        idents = [module.ident for module in wanted]
        try:
            yield from self._coe.upload(CONFIGURED, 0)
        except SdoAbortError as abort:
            raise RefusedError(self._slave, no_slots_text(abort_error(abort.code))) from abort
        before = yield from self._lists.read(CONFIGURED, 4, _SLOTS_MAX)
        if _stripped(before) == idents:
            return
        yield from self._write_list(idents + [0] * (len(before) - len(idents)), len(idents))
        now = yield from self._lists.read(CONFIGURED, 4, _SLOTS_MAX)
        if _stripped(now) != idents:
            raise RefusedError(
                self._slave,
                f"has accepted its list of modules, but has another one (0x{CONFIGURED:04X})",
            )

    def _write_list(self, idents: Sequence[int], count: int) -> Conversation[None]:
        """Writes the list. A slave with a fixed number of slots refuses to change the number.

        Args:
            idents: Idents of the modules, with 0 for each of the remaining slots.
            count: Number of idents without these slots.
        """
        counted = True
        try:
            yield from self._coe.download(CONFIGURED, 0, b"\0")
        except SdoAbortError:
            counted = False
        for slot, ident in enumerate(idents[:count] if counted else idents, 1):
            what = f"module {Module(ident).label} in slot {slot}"
            yield from write(self._slave, self._coe, (CONFIGURED, slot), "I", ident, what)
        if counted:
            what = f"a list of {count} modules"
            yield from write(self._slave, self._coe, (CONFIGURED, 0), "B", count, what)


def _stripped(idents: Sequence[int]) -> list[int]:
    """Returns a list without the empty slots at its end."""
    last = max((slot for slot, ident in enumerate(idents, 1) if ident), default=0)
    return list(idents[:last])
