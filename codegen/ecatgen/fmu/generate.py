"""Makes an FMU of a bus, as one function."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from ecatd.model.bus import Bus

from .. import scan
from ..profiles import load_profiles
from .archive import pack, write
from .build import build_fmu
from .files import fixed_files
from .render import render


@dataclass(frozen=True, slots=True)
class FmuReport:
    """What `generate_fmu` has done.

    Attributes:
        fmu: The file.
        fmi: Major version of FMI.
        slaves: Number of slaves.
        inputs: Number of inputs of the FMU, which it writes to the bus.
        outputs: Number of outputs of the FMU.
        changed: Whether the file is new or another one than before.
    """

    fmu: Path
    fmi: int
    slaves: int
    inputs: int
    outputs: int
    changed: bool

    def to_dict(self) -> dict[str, str | int | bool]:
        """The report as data, for JSON."""
        return {
            "fmu": str(self.fmu),
            "fmi": f"{self.fmi}.0",
            "slaves": self.slaves,
            "inputs": self.inputs,
            "outputs": self.outputs,
            "changed": self.changed,
        }

    def summary(self) -> str:
        """The report as one sentence."""
        return (
            f"{self.fmu}: FMI {self.fmi}.0, {self.slaves} slaves, {self.inputs} inputs, "
            f"{self.outputs} outputs, {'written' if self.changed else 'unchanged'}; import it into "
            f"a tool for co-simulation"
        )


def generate_fmu(
    bus: Bus, name: str, out: Path, fmi: int = 2, profiles: Iterable[Path] = ()
) -> FmuReport:
    """Writes a co-simulation FMU for a bus.

    The same bus and name give the same bytes. An earlier result in `out` is replaced.

    Args:
        bus: Description of the bus.
        name: Name of the model, a Modelica identifier.
        out: Directory that the file `name`.fmu is written to.
        fmi: Major version of FMI: 2 or 3.
        profiles: Folders with device profiles of the user; an earlier one wins.

    Raises:
        ConfigError: A device profile is wrong.
        UsageError: The name cannot be that of a model.
        StateError: The file is there and was not generated, or was changed since.
        NotPermittedError: The directory cannot be written.
        EcatError: The binary is not built, or there is none for this platform.
    """
    fixed = fixed_files(fmi, name)
    sources = [path.removeprefix("sources/") for path in fixed if path.endswith(".c")]
    made, known = scan.essence(bus), load_profiles(profiles)
    fixed[f"resources/{Path(scan.PATH).name}"] = scan.scan_file(made)
    token = _token(render(build_fmu(made, name, fmi, known, sources, "")) | fixed)
    fmu = build_fmu(made, name, fmi, known, sources, token)
    path = out / f"{fmu.name}.fmu"
    changed = write(path, pack(render(fmu) | fixed))
    return FmuReport(
        fmu=path,
        fmi=fmi,
        slaves=len(fmu.slaves),
        inputs=sum(item.causality == "input" for item in fmu.variables),
        outputs=sum(item.causality == "output" for item in fmu.variables),
        changed=changed,
    )


def _token(files: dict[str, bytes]) -> str:
    """A GUID that differs when anything in the FMU does."""
    digest = hashlib.sha256()
    for path in sorted(files):
        digest.update(path.encode() + b"\0" + files[path] + b"\0")
    text = digest.hexdigest()
    return f"{{{text[:8]}-{text[8:12]}-{text[12:16]}-{text[16:20]}-{text[20:32]}}}"
