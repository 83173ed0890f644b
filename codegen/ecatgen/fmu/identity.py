"""The token of an FMU, by which its model description and its binary know each other."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace

from .ir import Fmu
from .render import render


def with_token(fmu: Fmu, fixed: Mapping[str, bytes]) -> Fmu:
    """Returns the FMU with a GUID that changes whenever a file in the FMU changes.

    Args:
        fmu: The FMU without a token.
        fixed: The files that do not depend on it.
    """
    files = {**render(fmu), **fixed}
    digest = hashlib.sha256()
    for path in sorted(files):
        digest.update(path.encode() + b"\0" + files[path] + b"\0")
    text = digest.hexdigest()
    token = f"{{{text[:8]}-{text[8:12]}-{text[12:16]}-{text[16:20]}-{text[20:32]}}}"
    return replace(fmu, token=token)
