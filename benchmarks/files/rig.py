"""A rig of two drives with a large file."""

from ecatsim.devices.generic_drive import CiA402Drive
from ecatsim.rig import Rig
from ecatsim.slave.sii import Mailbox

NAME, SIZE = "large.bin", 10 * 1000 * 1000
_MAILBOX = 1024


class WithFiles(CiA402Drive):
    """A drive with mailboxes of 1 KiB, as drives that take firmware have."""

    mailbox = Mailbox(0x1000, _MAILBOX, 0x1400, _MAILBOX, protocols=0x0C)
    files = {NAME: bytes(range(250)) * (SIZE // 250)}  # noqa: RUF012


def rig() -> Rig:
    return Rig("files", [WithFiles(), WithFiles()])
