"""Changes settings of the running system, remembers what they were, and changes them back.

The list of changes is in `/run`. A start of the system empties `/run`, and also resets the
settings.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from ecatd.base.atomic_write import write_whole
from ecatd.base.errors import NotPermittedError, StateError
from ecatd.base.paths import DOCTOR_CHANGES, user_dir
from ecatd.linux import ethtool

from .findings import Change
from .values import text_change


def mend(changes: Sequence[Change]) -> Iterator[str]:
    """Makes the changes; yields a sentence about each.

    Raises:
        NotPermittedError: Only root may do that.
        StateError: The list of what was changed cannot be written.
    """
    before = _read()
    for change in changes:
        was = change.read()
        before.setdefault(change.name, was)
        _write(before)  # write the list first, so that each change can be undone whatever happens
        yield _set(change, was)


def undo() -> Iterator[str]:
    """Changes back what `mend` has changed; yields a sentence about each.

    Raises:
        NotPermittedError: Only root may do that.
        StateError: The list of what was changed is damaged.
    """
    before = _read()
    for name, value in list(before.items()):
        change = _change(name, value)
        try:
            yield _set(change, change.read())
            done = change.read() == value
        except (OSError, ValueError) as error:  # the adapter may be gone, for example
            yield f"{name}: cannot be changed back to {value}: {error}"
            done = False
        if done:
            del before[name]
            _write(before)
    if not before:
        _list().unlink(missing_ok=True)


def _set(change: Change, was: str) -> str:
    try:
        change.write(change.wanted)
    except PermissionError as error:
        raise NotPermittedError(f"{change.name}: only root may change it; use sudo") from error
    except (OSError, ValueError) as error:
        return f"{change.name}: {was}; the system refuses {change.wanted} ({error})"
    now = change.read()
    return f"{change.name}: {was} -> {now}"


def _change(name: str, wanted: str) -> Change:
    """The setting of this name, as `mend` has written it."""
    first, _, second = name.partition(" ")
    if first == "IRQ" and second.isdecimal():
        return text_change(name, Path("/proc/irq") / second / "smp_affinity_list", wanted)
    if second == "governor":
        file = Path("/sys/devices/system/cpu") / first / "cpufreq/scaling_governor"
        return text_change(name, file, wanted)
    if second == "coalescing":
        get, put = partial(ethtool.coalescing, first), partial(ethtool.set_coalescing, first)
        return Change(name, get, put, wanted)
    if second == "eee":
        get = partial(ethtool.energy_efficient, first)
        return Change(name, get, partial(ethtool.set_energy_efficient, first), wanted)
    if second in ethtool.OFFLOADS:
        get = partial(ethtool.offload, first, second)
        return Change(name, get, partial(ethtool.set_offload, first, second), wanted)
    raise StateError(f"{_list()} names '{name}', which is unknown: remove the file")


def _list() -> Path:
    """The list of changes."""
    return user_dir().with_name(DOCTOR_CHANGES)


def _read() -> dict[str, str]:
    try:
        found = json.loads(_list().read_text())
        return {str(name): str(value) for name, value in found.items()}
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, AttributeError) as error:
        raise StateError(f"{_list()} cannot be read ({error}): remove it") from error


def _write(before: dict[str, str]) -> None:
    try:
        write_whole(_list(), json.dumps(before, indent=1).encode(), ".ecatd-doctor-")
    except PermissionError as error:
        raise NotPermittedError("only root may change the system: use sudo") from error
    except OSError as error:
        raise StateError(f"{_list()} cannot be written: {error.strerror}") from error
