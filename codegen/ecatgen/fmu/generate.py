"""Generates an FMU for a bus: the generator as one function."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ecatd.base.errors import StateError
from ecatd.description.bus import Bus

from .. import can
from ..build import build_library, left_out
from ..differences import Difference, compare, lines
from ..names import library_name
from ..origin import dump_origin, essence, read_origin
from .archive import member, pack, write
from .build import build_fmu
from .drives import unsuitable_drives
from .files import fixed_files
from .identity import with_token
from .render import render

_ORIGIN = "resources/bus.json"
_CAN = f"resources/{can.FILE}"


@dataclass(frozen=True, slots=True)
class FmuReport:
    """The result of `generate_fmu`: the changes that it has made or would make.

    Attributes:
        fmu: The file.
        fmi: Major version of FMI.
        slaves: Number of slaves.
        inputs: Number of inputs of the FMU; it writes them to the bus.
        outputs: Number of outputs of the FMU.
        is_change: Whether the file is new or differs from the one before.
        differences: Changes of the bus since the file was made, by slave and connector.
        otherwise: Whether the file differs although nothing has changed on the bus.
        notes: A sentence for all that files of CAN buses, or drives, have, and the FMU has not.
    """

    fmu: Path
    fmi: int
    slaves: int
    inputs: int
    outputs: int
    is_change: bool
    differences: tuple[Difference, ...] = ()
    otherwise: bool = False
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Returns the report as data, for JSON."""
        return {
            "fmu": str(self.fmu),
            "fmi": f"{self.fmi}.0",
            "slaves": self.slaves,
            "inputs": self.inputs,
            "outputs": self.outputs,
            "changed": self.is_change,
            "differences": [item.to_dict() for item in self.differences],
            "generator": self.otherwise,
            "notes": list(self.notes),
        }

    def details(self) -> list[str]:
        """Returns the differences, one sentence per line."""
        if self.otherwise:
            return [*self.notes, "the bus is the same, but the version of ecatd or FMI is not"]
        return [*self.notes, *lines(self.differences)]

    def summary(self) -> str:
        """Returns the report as one sentence."""
        return (
            f"{self.fmu}: FMI {self.fmi}.0, {self.slaves} slaves, {self.inputs} inputs, "
            f"{self.outputs} outputs, {'written' if self.is_change else 'unchanged'}; import it "
            f"into a tool for co-simulation"
        )

    def would(self) -> str:
        """Returns the changes that a run would make, as one sentence."""
        return f"{self.fmu} would change" if self.is_change else f"{self.fmu}: nothing would change"


def generate_fmu(
    bus: Bus,
    name: str,
    out: Path,
    fmi: int = 2,
    *,
    messages: Sequence[can.CanFile] | None = None,
    check: bool = False,
) -> FmuReport:
    """Writes a co-simulation FMU for a bus.

    The same bus and name give the same bytes. An earlier result in `out` is replaced.

    Args:
        bus: Description of the bus.
        name: Name of the model, a Modelica identifier.
        out: Directory that the file `name`.fmu is written to.
        fmi: Major version of FMI: 2 or 3.
        messages: The messages of CAN buses behind slaves; None: those of the FMU before.
        check: Write nothing, only report what would change.

    Raises:
        UsageError: `name` cannot be the name of a model.
        StateError: The file exists and was not generated, or was changed since; or a terminal with
            the CAN messages of the FMU before is gone, or these cannot be read.
        NotPermittedError: The directory cannot be written.
        EcatError: The binary is not built, or there is none for this platform.
    """
    made_from = essence(bus)
    path = out / f"{library_name(name)}.fmu"
    earlier: Sequence[can.CanFile] = ()
    if (data := member(path, _CAN)) is not None:
        with nullcontext() if messages is None else suppress(StateError):
            earlier = can.remembered(data, f"{path}, {_CAN}")
    messages = can.on_bus(earlier, made_from) if messages is None else messages
    library = build_library(made_from, name, messages)
    fixed = fixed_files(fmi, library.name)
    fixed[_ORIGIN] = dump_origin(made_from)
    if messages:
        fixed[_CAN] = can.dump(messages)
    sources = [path.removeprefix("sources/") for path in fixed if path.endswith(".c")]
    fmu = with_token(build_fmu(made_from, library, fmi, sources), fixed)
    before = read_origin(member(path, _ORIGIN))
    changed = write(path, pack(render(fmu) | fixed), check=check)
    differences: tuple[Difference, ...] = ()
    if changed and before is not None:
        old = build_library(before, name, earlier)
        differences = compare((before, old), (made_from, library))
    return FmuReport(
        fmu=path,
        fmi=fmi,
        slaves=len(fmu.slaves),
        inputs=sum(item.causality == "input" for item in fmu.variables),
        outputs=sum(item.causality == "output" for item in fmu.variables),
        is_change=changed,
        differences=differences,
        otherwise=changed and before is not None and not differences,
        notes=(*left_out(library.blocks), *unsuitable_drives(library.blocks)),
    )
