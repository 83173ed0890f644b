"""Who owns which outputs of a bus, out of its shared memory."""

from __future__ import annotations

from typing import Any

from .contents import Contents
from .reader import opened


def read_claims(bus: str) -> dict[str, Any]:
    """The clients of a bus on this machine, and all outputs with who decides them; asks nobody.

    Returns:
        A map, as `ecatctl claims --json` prints it (docs/command-line.md).

    Raises:
        EcatError: No daemon serves the bus, this user may not read it, or the shared memory is of
            another version or damaged beyond use.
    """
    with opened(bus) as shared:
        contents = Contents(shared)
        return {
            **contents.summary(),
            "slots": contents.slots(),
            "slaves": [
                {"position": slave["position"], "name": slave["name"]}
                for slave in contents.slaves()
            ],
            "outputs": contents.signals(outputs=True),
            "problems": contents.problems,
        }
