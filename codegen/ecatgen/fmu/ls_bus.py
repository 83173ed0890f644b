"""Generates an FMU whose CAN bus is the one behind a terminal, for virtual ECUs (FMI-LS-BUS)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ecatd.base.errors import UsageError
from ecatd.description.bus import Bus

from .. import can
from ..build import build_library
from ..origin import essence
from ..text import Code
from .archive import pack, write
from .build import build_fmu
from .common_variables import TX_CLOCKS
from .files import fixed_files
from .identity import with_token
from .render import render

MOST_ECUS = 16
_FMI = 3  # the first version with clocks
_ANY_BUS = Code("0000000000000000")


@dataclass(frozen=True, slots=True)
class LsBusReport:
    """The result of `generate_ls_bus`.

    Attributes:
        fmu: The file.
        slave: The terminal, by name and position.
        ecus: Number of bus terminals.
        is_change: Whether the file is new or differs from the one before.
    """

    fmu: Path
    slave: str
    ecus: int
    is_change: bool

    def to_dict(self) -> dict[str, Any]:
        """Returns the report as data, for JSON."""
        return {
            "fmu": str(self.fmu),
            "fmi": f"{_FMI}.0",
            "slave": self.slave,
            "ecus": self.ecus,
            "changed": self.is_change,
        }

    def details(self) -> list[str]:
        """Returns nothing: there are no details."""
        return []

    def summary(self) -> str:
        """Returns the report as one sentence."""
        terminals = "1 bus terminal" if self.ecus == 1 else f"{self.ecus} bus terminals"
        return (
            f"{self.fmu}: FMI {_FMI}.0 with FMI-LS-BUS 1.0, {terminals} on the CAN bus behind "
            f"{self.slave}, {'written' if self.is_change else 'unchanged'}; connect virtual ECUs"
        )

    def would(self) -> str:
        """Returns the changes that a run would make, as one sentence."""
        return f"{self.fmu} would change" if self.is_change else f"{self.fmu}: nothing would change"


def generate_ls_bus(
    bus: Bus,
    name: str,
    out: Path,
    slave: int | str,
    ecus: int = 1,
    tx_clock: str = TX_CLOCKS[0],
    *,
    check: bool = False,
) -> LsBusReport:
    """Writes a bus simulation FMU for the CAN bus behind a terminal.

    The same terminal and name give the same bytes, whatever else is on the bus. An earlier result
    in `out` is replaced.

    Args:
        bus: Description of the EtherCAT bus.
        name: Name of the model, a Modelica identifier.
        out: Directory that the file `name`.fmu is written to.
        slave: Position or name of the terminal.
        ecus: Number of virtual ECUs that can be connected.
        tx_clock: How an importer learns that there is something for an ECU: one of `TX_CLOCKS`.
        check: Write nothing, only report what would change.

    Raises:
        UsageError: `name` cannot be the name of a model, there are too many ECUs, or the slave is
            no CAN terminal.
        StateError: There is no such slave, or the file exists and was not generated, or was changed
            since.
        NotPermittedError: The directory cannot be written.
        EcatError: The binary is not built, or there is none for this platform.
    """
    if not 1 <= ecus <= MOST_ECUS:
        raise UsageError(f"{ecus} virtual ECUs: an FMU has bus terminals for 1 to {MOST_ECUS}")
    position = can.terminal(bus, slave, f"--ls-bus {slave}").position
    library = build_library(essence(bus), name)
    block = next(item for item in library.blocks if item.position == position)
    given = "" if ecus == 1 else f" --ls-bus-ecus {ecus}"
    given += "" if tx_clock == TX_CLOCKS[0] else f" --ls-bus-clock {tx_clock}"
    library = replace(
        library,
        description=f"The CAN bus behind {block.slave_label} on the EtherCAT bus {bus.name}",
        fingerprint=_ANY_BUS,
        command=f"{library.command} --ls-bus {block.given_name or position}{given}",
        blocks=(replace(block, reads=(), writes=()),),
    )
    fixed = fixed_files(_FMI, library.name)
    sources = [path.removeprefix("sources/") for path in fixed if path.endswith(".c")]
    fmu = with_token(build_fmu(bus, library, _FMI, sources, ecus, tx_clock), fixed)
    path = out / f"{fmu.name}.fmu"
    changed = write(path, pack(render(fmu) | fixed), check=check)
    return LsBusReport(path, block.slave_label, ecus, changed)
