"""The files that the configuration names: the description of the complete bus, and folders."""

from __future__ import annotations

from pathlib import Path

from ecatd.base.errors import UsageError
from ecatd.base.files import is_folder
from ecatd.description.bus import Bus
from ecatd.description.bus_file import load

from .. import Config


def missing_folders(config: Config) -> list[str]:
    """Warns about folders that do not exist: `flight_recorder.folder`, and that of `audit_file`.

    This is not an error: the recorder makes the first one at its start, if its user may.
    """
    folder = config.flight_recorder.folder
    texts = missing_audit_folder(config)
    if folder and not is_folder(Path(folder)):
        texts.append(
            f"{config.flight_recorder.table.where('folder')}: there is no folder {folder}: "
            "ecatd makes it at its start if its user may, and otherwise writes no incidents; make "
            "it for that user, or correct the path"
        )
    return texts


def missing_audit_folder(config: Config) -> list[str]:
    """Warns if the folder of `audit_file` does not exist. Nobody but its administrator makes it."""
    folder = Path(config.audit_file).parent
    if not config.audit_file or is_folder(folder):
        return []
    return [
        f"{config.table.where('audit_file')}: there is no folder {folder}, so changes are only in "
        "the log: make it for the user of ecatd, or correct the path"
    ]


def load_description(config: Config) -> Bus | None:
    """Reads the file `description` of `[expected]`; None if there is none.

    Raises:
        ConfigError: It cannot be read.
    """
    if not config.expected.description:
        return None
    try:
        return load(Path(config.expected.description))
    except UsageError as error:
        config.expected.table.fail(
            "description",
            f"{error}: write it with `ecatctl scan -o` while all slaves are there and ecatd runs "
            "without this key",
        )
