"""Settings of the running system: what they are, changing them, and changing them back.

The list of changes is in `/run`. A start of the system empties `/run`, and also resets the
settings.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from ecatd.base.errors import NotPermittedError, StateError
from ecatd.base.files import write_whole
from ecatd.base.paths import DOCTOR_CHANGES, user_dir
from ecatd.linux import ethtool


class Change(NamedTuple):
    """A better value of a setting.

    Attributes:
        name: The setting: `cpu0 governor`, `IRQ 41`, or an interface and a setting of `ethtool`.
        wanted: The better value.
    """

    name: str
    wanted: str


class _Setting(NamedTuple):
    read: Callable[[], str]
    write: Callable[[str], object]


def read(file: Path) -> str:
    """The text of a file without the space around it; empty if it cannot be read."""
    try:
        return file.read_text().strip()
    except (OSError, UnicodeDecodeError):
        return ""


def mend(changes: Sequence[Change]) -> Iterator[str]:
    """Makes the changes; yields a sentence about each.

    Raises:
        NotPermittedError: Only root may do that.
        StateError: The list of what was changed cannot be written.
    """
    before = _read_list()
    for change in changes:
        was = _setting(change.name).read()
        before.setdefault(change.name, was)
        _write_list(before)  # first, so that each change can be undone whatever happens
        yield _make(change, was)


def undo() -> Iterator[str]:
    """Changes back what `mend` has changed; yields a sentence about each.

    Raises:
        NotPermittedError: Only root may do that.
        StateError: The list of what was changed is damaged.
    """
    before = _read_list()
    for change in [Change(*item) for item in before.items()]:
        setting = _setting(change.name)
        try:
            yield _make(change, setting.read())
            done = setting.read() == change.wanted
        except (OSError, ValueError) as error:  # the adapter may be gone, for example
            yield f"{change.name}: cannot be changed back to {change.wanted}: {error}"
            done = False
        if done:
            del before[change.name]
            _write_list(before)
    if not before:
        _list().unlink(missing_ok=True)


def _make(change: Change, was: str) -> str:
    setting = _setting(change.name)
    try:
        setting.write(change.wanted)
    except PermissionError as error:
        raise NotPermittedError(f"{change.name}: only root may change it; use sudo") from error
    except (OSError, ValueError) as error:
        return f"{change.name}: {was}; the system refuses {change.wanted} ({error})"
    return f"{change.name}: {was} -> {setting.read()}"


def _setting(name: str) -> _Setting:
    first, _, second = name.partition(" ")
    if second in ethtool.SETTINGS:
        return _Setting(partial(ethtool.read, first, second), partial(ethtool.write, first, second))
    if first == "IRQ" and second.isdecimal():
        file = Path("/proc/irq") / second / "smp_affinity_list"
    elif second == "governor":
        file = Path("/sys/devices/system/cpu") / first / "cpufreq/scaling_governor"
    else:
        raise StateError(f"{_list()} names '{name}', which is unknown: remove the file")
    return _Setting(partial(read, file), file.write_text)


def _list() -> Path:
    return user_dir().with_name(DOCTOR_CHANGES)


def _read_list() -> dict[str, str]:
    """What was changed: the values before, by the names of the settings."""
    try:
        found = json.loads(_list().read_text())
        return {str(name): str(value) for name, value in found.items()}
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, AttributeError) as error:
        raise StateError(f"{_list()} cannot be read ({error}): remove it") from error


def _write_list(before: dict[str, str]) -> None:
    try:
        write_whole(_list(), json.dumps(before, indent=1).encode(), ".ecatd-doctor-")
    except PermissionError as error:
        raise NotPermittedError("only root may change the system: use sudo") from error
    except OSError as error:
        raise StateError(f"{_list()} cannot be written: {error.strerror}") from error
