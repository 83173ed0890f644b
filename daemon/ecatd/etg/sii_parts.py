"""Reads parts of an SII: what a slave is, its modes of distributed clocks, its mailbox."""

from __future__ import annotations

import struct

from .sii import (
    CATEGORY_DC,
    CATEGORY_GENERAL,
    CATEGORY_STRINGS,
    CATEGORY_SYNC_MANAGER,
    Sii,
    SiiDc,
    SiiMailbox,
    SiiSyncManager,
    mailbox_managers,
    replace_overlapping,
)
from .sii_categories import Words
from .sii_reader import SiiReader

_MAILBOX_WRITTEN, _MAILBOX_READ = 0x26, 0x22  # control of sync managers 0 and 1 (ETG.1000.4)


def read_name(words: Words) -> Sii:
    """Reads what a slave is, and how it tells its identification; nothing of its process data.

    Args:
        words: Reads words of the EEPROM.
    """
    return _NameReader(words).read()


def read_dc_modes(words: Words) -> list[SiiDc]:
    """Reads the operation modes of the distributed clocks (category 60), if there are any.

    Args:
        words: Reads words of the EEPROM.
    """
    return _DcReader(words).read().dc


def read_mailbox(words: Words) -> list[SiiSyncManager]:
    """Reads the settings of the mailbox: sync managers 0 and 1; empty if there is no mailbox.

    They are those of category 41. If it is missing, or does not begin with the two mailboxes, they
    follow from the standard mailbox (words 0x18 to 0x1B). `sii_reader` notes where both differ.

    Args:
        words: Reads words of the EEPROM.
    """
    sii = _MailboxReader(words).read()
    box = sii.mailbox
    if managers := mailbox_managers(sii.sync_managers):
        replace_overlapping(managers, box)
        return managers
    if not box.written:
        return []
    return [
        SiiSyncManager(box.receive, box.receive_size, _MAILBOX_WRITTEN, 1, 1),
        SiiSyncManager(box.send, box.send_size or box.receive_size, _MAILBOX_READ, 1, 2),
    ]


class _NameReader(SiiReader):
    """Decodes only what the slave is."""

    wanted = frozenset({CATEGORY_STRINGS, CATEGORY_GENERAL})


class _DcReader(SiiReader):
    """Decodes only the modes of the distributed clocks."""

    wanted = frozenset({CATEGORY_STRINGS, CATEGORY_DC})


class _MailboxReader(SiiReader):
    """Decodes only the settings of the mailbox."""

    wanted = frozenset({CATEGORY_SYNC_MANAGER})

    def header(self) -> None:
        self.sii.mailbox = SiiMailbox(*struct.unpack("<4H", self._words(0x18, 4)))

    def compare_mailboxes(self) -> None:
        """Leaves the words as they are."""
