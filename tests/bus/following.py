"""Commands that go on without end: `ecatctl watch` and `ecatctl events -f`."""

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class Following:
    """A command that runs, with `--json`; what it says goes to files."""

    def __init__(
        self,
        *arguments: str,
        env: dict[str, str] | None = None,
        preexec: Callable[[], None] | None = None,
    ) -> None:
        self._folder = tempfile.TemporaryDirectory()
        self._out, self._said = (Path(self._folder.name) / name for name in ("out", "said"))
        with self._out.open("w") as out, self._said.open("w") as said:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "ecatd.cli", *arguments, "--json"],
                env=env,
                stdout=out,
                stderr=said,
                preexec_fn=preexec,
            )

    @property
    def documents(self) -> list[dict[str, Any]]:
        """What it has shown, a document in each line; fails if it has ended."""
        assert self.process.poll() is None, self.said
        return [json.loads(line) for line in self._out.read_text().split("\n")[:-1]]

    @property
    def said(self) -> str:
        """What it has written to stderr."""
        return self._said.read_text()

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        self._folder.cleanup()


@contextmanager
def following(*arguments: str, env: dict[str, str] | None = None) -> Iterator[Following]:
    """The same, ended after the block."""
    command = Following(*arguments, env=env)
    try:
        yield command
    finally:
        command.close()
