"""Commands `sii-write` and `alias`: change what is in the EEPROM of a slave."""

from __future__ import annotations

import argparse
import difflib
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ecatd.base.errors import BusyError, EcatError, NotPermittedError, StateError, UsageError
from ecatd.config.expected_bus import compare
from ecatd.description.bus import Slave
from ecatd.etg.intel_hex import image_bytes
from ecatd.etg.sii import Sii
from ecatd.etg.sii_categories import FIRST_CATEGORY
from ecatd.etg.sii_check import MAX_IMAGE, check_sii, sii_checksum
from ecatd.operations.eeproms import SII_WORDS_MAX, ReadSii, WriteSii

from .arguments import add_one_slave, add_yes, bounded, confirm
from .output import counted, print_json
from .saving import check_target, read_bytes, save_bytes
from .sii import read_image, sii_lines

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

COMMANDS = {
    "mailboxes": {
        "sii-write": "Write a file into the EEPROM of a slave.",
        "alias": "Write the station alias into the EEPROM of a slave.",
    },
}

_ALIAS, _CHECKSUM = 4, 7  # words of the configuration area (ETG.1000.6, table "SII")
_PART = 2 * SII_WORDS_MAX
_MAX_FILE = 4 * MAX_IMAGE  # in Intel HEX, a byte takes about three
_LATER = "the slave uses it from its next power-on"


def add_arguments(command: argparse.ArgumentParser, name: str) -> None:
    """Adds the arguments of a command."""
    add_one_slave(command)
    if name == "alias":
        command.add_argument(
            "alias", type=bounded(0, 0xFFFF), metavar="ALIAS", help="the alias, 0 for none"
        )
        add_yes(command)
        return
    command.add_argument(
        "file", type=Path, metavar="FILE", help=("a file that `ecatctl sii-read -o` has written")
    )
    command.add_argument(
        "--backup",
        metavar="FILE",
        type=Path,
        help=(
            "save the previous bytes to this file (default: sii-BUS-POSITION-TIME.bin in this "
            "folder)"
        ),
    )
    command.add_argument("--dry-run", action="store_true", help="only show what would change")
    command.add_argument(
        "--force", action="store_true", help="write the bytes even if they are not a valid EEPROM"
    )
    add_yes(command)


# --- sii-write -----------------------------------------------------------------------------------


def sii_write(remote: Remote, options: argparse.Namespace) -> None:
    """Writes an EEPROM: shows what changes, asks, saves what was there, writes, reads back."""
    image = _read(options.file)
    new = check_sii(image)
    _check(options, new)
    found = remote.describe().find(options.slave)
    before = read_image(remote, found)
    if len(image) > len(before):
        raise UsageError(
            f"{options.file} has {len(image)} bytes, but the EEPROM of {found.label} has "
            f"{len(before)}; nothing was written"
        )
    old = check_sii(before)
    parts = _changed_parts(before, image)
    words = sum(_differing(before, image, at, _PART) for at in parts)
    changes = _changes(old, new, len(before))
    if not options.json:
        print("\n".join(changes) or "the decoded fields are the same")
    backup = None
    if words and not options.dry_run:
        confirm(options, _about(found, old, new, words))
        backup = options.backup or Path(
            f"sii-{remote.bus}-{found.position}-{time.strftime('%Y%m%d-%H%M%S')}.bin"
        )
        if backup.exists():
            raise UsageError(f"{backup} exists: give another --backup; nothing was written")
        check_target(backup, force=False)
        _check_unchanged(found, before, read_image(remote, found))
        save_bytes(backup, before, force=False)
        _write(remote, found, image, parts, backup)
    _report(remote, options, found, words, changes, backup)


def _read(path: Path) -> bytes:
    """Reads a file that may be an EEPROM.

    Raises:
        UsageError: The file cannot be read, or cannot be an EEPROM.
    """
    image = image_bytes(read_bytes(path, _MAX_FILE), str(path), _warn)
    least = 2 * FIRST_CATEGORY
    if len(image) % 2 or not least <= len(image) <= MAX_IMAGE:
        raise UsageError(
            f"{path} is not an EEPROM: it has {len(image)} bytes, but an EEPROM has words of 2 "
            f"bytes, at least {least} and at most {MAX_IMAGE} bytes"
        )
    return image


def _warn(text: str) -> None:
    print(f"ecatctl: warning: {text}", file=sys.stderr)


def _check(options: argparse.Namespace, new: Sii) -> None:
    damage = [problem for problem in new.problems if problem.damage]
    if damage and not options.force:
        more = f" (and {len(damage) - 1} more)" if len(damage) > 1 else ""
        raise UsageError(
            f"{options.file}: {damage[0]}{more}; nothing was written. --force writes it as it is"
        )
    for problem in new.problems:
        print(f"ecatctl: warning: {options.file}: {problem}", file=sys.stderr)


def _changed_parts(before: bytes, image: bytes) -> list[int]:
    """Addresses of the first bytes of the parts that differ."""
    return [
        at
        for at in range(0, len(image), _PART)
        if before[at : at + len(image[at : at + _PART])] != image[at : at + _PART]
    ]


def _differing(before: bytes, image: bytes, at: int, size: int) -> int:
    """How many words of a part differ."""
    end = min(at + size, len(image))
    return sum(before[byte : byte + 2] != image[byte : byte + 2] for byte in range(at, end, 2))


def _changes(old: Sii, new: Sii, size: int) -> list[str]:
    """The decoded fields that differ: the previous ones with `-`, the new ones with `+`."""
    lines = difflib.ndiff([*sii_lines(old, size)], [*sii_lines(new, size)])
    return [line for line in lines if line[:1] in "-+"]


def _about(found: Slave, old: Sii, new: Sii, words: int) -> str:
    text = f"This writes {_words(words)} of the EEPROM of {found.label}."
    if (old.vendor, old.product) != (new.vendor, new.product):
        text += (
            f" Every master will take it for another device: vendor 0x{new.vendor:08X}, product "
            f"0x{new.product:08X}."
        )
    return text


def _write(remote: Remote, found: Slave, image: bytes, parts: Sequence[int], backup: Path) -> None:
    """Writes the parts, and reads everything back.

    Raises:
        EcatError: The slave cannot be written; the message says how to go back.
    """
    begun = False
    try:
        for at in counted(parts, "parts"):
            data, more = image[at : at + _PART], at != parts[-1]
            remote.request(WriteSii(found.position, at // 2, data, more=more))["written"]
            begun = True
        if read_image(remote, found)[: len(image)] != image:
            raise StateError(f"{found.label}: the EEPROM does not have the words that were written")
    except EcatError as error:
        if not begun and isinstance(error, NotPermittedError | UsageError | BusyError):
            backup.unlink()  # nothing was written
            raise
        raise type(error)(
            f"{error}. A part may be written: try again, or write the previous bytes back with "
            f"`ecatctl sii-write {found.position} {backup}`"
        ) from error


def _check_unchanged(found: Slave, before: bytes, now: bytes) -> None:
    """Checks what was there a moment ago: somebody else may have written during the question.

    Raises:
        StateError: It is no longer there.
    """
    if now != before:
        raise StateError(
            f"somebody else has written the EEPROM of {found.label} in the meantime: nothing was "
            "written, try again"
        )


def _words(count: int) -> str:
    return "1 word" if count == 1 else f"{count} words"


def _report(
    remote: Remote,
    options: argparse.Namespace,
    found: Slave,
    words: int,
    changes: Sequence[str],
    backup: Path | None,
) -> None:
    written = 0 if options.dry_run else words
    if options.json:
        document = {"bus": remote.bus, "slave": found.position, "differ": words, "written": written}
        file = None if backup is None else str(backup)
        print_json({**document, "changes": [*changes], "backup": file})
    elif not words:
        print(f"the EEPROM of {found.label} has these bytes already: nothing was written")
    elif options.dry_run:
        print(f"{_words(words)} would be written")
    else:
        print(f"written: {_words(words)}; {_LATER}. The previous bytes are in {backup}")


# --- alias ---------------------------------------------------------------------------------------


def _warn_of_alias(remote: Remote, found: Slave, alias: int) -> None:
    """Warns if the next start would not find the slave by its new alias."""
    bus, (config, _) = remote.describe(), remote.configuration()
    others = [item for item in bus.slaves if item.position != found.position]
    same = [
        item.label
        for item in others
        if alias and (item.alias == alias or _next_alias(remote, item) == alias)
    ]
    if same:
        text = f"{', '.join(same)} has this alias, too, so a start cannot tell which is which"
        print(f"ecatctl: warning: {text}", file=sys.stderr)
    wanted = config.moved(compare(config, bus.slaves).places).settings_of(found.position)
    if wanted.alias not in (None, alias):
        text = (
            f"the configuration finds {found.label} by the alias {wanted.alias}: correct it before "
            "the next start, or it does not find the slave"
        )
        print(f"ecatctl: warning: {text}", file=sys.stderr)


def _next_alias(remote: Remote, slave: Slave) -> int:
    """The alias that a slave will have after its next start; 0: none, or it does not answer now."""
    try:
        return int.from_bytes(remote.request(ReadSii(slave.position, _ALIAS, 1))["data"], "little")
    except EcatError:
        return 0


def alias(remote: Remote, options: argparse.Namespace) -> None:
    """Writes the configured station alias, and the checksum that belongs to it."""
    found = remote.describe().find(options.slave)
    head = remote.request(ReadSii(found.position, 0, _CHECKSUM + 1))["data"]
    before = int.from_bytes(head[2 * _ALIAS : 2 * _ALIAS + 2], "little")
    if sii_checksum(head[: 2 * _CHECKSUM]) != head[2 * _CHECKSUM]:
        raise StateError(
            f"the EEPROM of {found.label} has a wrong checksum, which hides other errors: repair "
            f"it first with `ecatctl sii-write {found.position} FILE`; nothing was written"
        )
    if before != options.alias:
        _warn_of_alias(remote, found, options.alias)
        confirm(
            options, f"This changes the alias of {found.label} from {before} to {options.alias}."
        )
        now = remote.request(ReadSii(found.position, 0, _CHECKSUM + 1))["data"]
        _check_unchanged(found, head, now)
        changed = head[: 2 * _ALIAS] + options.alias.to_bytes(2, "little") + head[2 * _ALIAS + 2 :]
        checksum = sii_checksum(changed[: 2 * _CHECKSUM]).to_bytes(2, "little")
        # All words under the checksum are written, so that it fits even after another write.
        remote.request(WriteSii(found.position, 0, changed[: 2 * _CHECKSUM] + checksum))["written"]
    if options.json:
        document = {"bus": remote.bus, "slave": found.position, "alias": options.alias}
        print_json({**document, "before": before})
    elif before == options.alias:
        print(f"{found.label} has the alias {before} already: nothing was written")
    else:
        print(f"{found.label} has the alias {options.alias} in its EEPROM; {_LATER}")
