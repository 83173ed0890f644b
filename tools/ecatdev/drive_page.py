"""Writes the tables of docs/drive-profiles.md, from the files of the drives.

PYTHONPATH=tools .venv/bin/python -m ecatdev.drive_page
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path

from ecatsim.devices import drives
from ecatsim.devices.modes import Mode
from ecatsim.files.drive_file import ProfileDrive
from ecatsim.slave.sii import UNASSIGNED

from .page_parts import head, row

PAGE = Path(__file__).parents[2] / "docs" / "drive-profiles.md"
_BEGIN, _END = "<!-- drives -->\n\n", "\n\n<!-- /drives -->"
_SHORT = {
    Mode.PROFILE_POSITION: "PP",
    Mode.PROFILE_VELOCITY: "PV",
    Mode.PROFILE_TORQUE: "PT",
    Mode.HOMING: "HM",
    Mode.INTERPOLATED_POSITION: "IP",
    Mode.CYCLIC_POSITION: "CSP",
    Mode.CYCLIC_VELOCITY: "CSV",
    Mode.CYCLIC_TORQUE: "CST",
}


def tables() -> Iterator[str]:
    """Yields the lines of the tables."""
    made = {name: drives.kind(name)() for name in drives.NAMES}
    yield from head(
        *("device", "drive", "vendor, product", "default PDOs", "modes", "0x6502", "homing methods")
    )
    for name, drive in made.items():
        pdos = [p for p in (*drive.rx_pdos, *drive.tx_pdos) if p.sync_manager != UNASSIGNED]
        yield row(
            f"`{name}`",
            drive.name,
            f"0x{drive.vendor:X}, 0x{drive.product:08X}",
            ", ".join(f"0x{pdo.index:04X}" for pdo in pdos),
            ", ".join(_SHORT[mode] for mode in drive.options.modes if mode),
            f"0x{drive[0x6502, 0]:08X}",
            _ranges(drive.options.homing.methods) or "not known",
        )
    for name, drive in made.items():
        yield from ("", f"## `{name}`: {drive.name}", "")
        yield from _of_drive(drive)


def _of_drive(drive: ProfileDrive) -> Iterator[str]:
    yield "Sources:"
    yield ""
    yield from (f"- {source}" for source in drive.sources)
    yield ""
    yield from head("values", "unit", "source")
    for unit in drive.units:
        yield row(unit.what, unit.unit, unit.source)
    yield ""
    yield from head("about", "what differs from the standard", "simulated", "source")
    for item in drive.deviations:
        yield row(item.about, item.what, "yes" if item.simulated else "no", item.source)
    yield ""
    yield "Not found:"
    yield ""
    yield from (f"- {text}" for text in drive.unknown)


def _ranges(numbers: Iterable[int]) -> str:
    """Numbers as text, such as `-2 to 3, 7`."""
    parts = []
    for _, group in groupby(enumerate(sorted(numbers)), key=lambda item: item[1] - item[0]):
        run = [number for _, number in group]
        text = f"{run[0]} to {run[-1]}" if len(run) > 2 else ", ".join(map(str, run))
        parts.append(text.replace("-", "−"))
    return ", ".join(parts)


def page() -> str:
    """Returns the page with these tables."""
    before, _, rest = PAGE.read_text().partition(_BEGIN)
    return before + _BEGIN + "\n".join(tables()) + _END + rest.partition(_END.lstrip())[2]


if __name__ == "__main__":
    PAGE.write_text(page())
