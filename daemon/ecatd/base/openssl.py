"""Runs the program `openssl`, which makes certificates and keys, and unlocks these."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

from .errors import StateError

_PATIENCE_S = 60
"""It never asks a person, and no key here takes it longer."""


def openssl(*arguments: str | Path, given: str = "") -> str:
    """Runs `openssl`; returns what it prints.

    Args:
        arguments: Its arguments. All users of the machine can see them.
        given: What it reads, such as a password for `-passin stdin`.

    Raises:
        StateError: It is not installed, or fails.
    """
    program = shutil.which("openssl")
    if program is None:
        raise StateError("the program openssl is missing: sudo apt install openssl")
    try:
        found = subprocess.run(
            [program, *arguments],
            input=given,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            timeout=_PATIENCE_S,
            umask=0o077,
        )
    except subprocess.TimeoutExpired as error:
        raise StateError(f"openssl {arguments[0]} does not end") from error
    if found.returncode:
        lines = found.stderr.strip().splitlines() or ["no reason given"]
        raise StateError(f"openssl {arguments[0]} fails: {lines[-1]}")
    return found.stdout
