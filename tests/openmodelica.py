"""OpenModelica, for tests: scripts that it runs, and models as programs."""

from __future__ import annotations

import csv
import os
import re
import shutil
import subprocess
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

needs_omc = pytest.mark.skipif(
    shutil.which("omc") is None, reason="omc (OpenModelica) is not on PATH"
)

# What is said of blocks that look for an inner component, and of partial ones, when they are
# checked alone.
_EXPECTED = re.compile(
    r"top-level outer element|An inner declaration for outer component"
    r"|No corresponding 'inner' declaration|Forcing full instantiation of partial class"
)
_CLASS = re.compile(r"^@@ (\S+)$", re.MULTILINE)

Row = dict[str, float]


def at_home(home: Path) -> dict[str, str]:
    """The environment of a user who lives there, without the folders of this one's libraries."""
    inherited = {k: v for k, v in os.environ.items() if k != "OPENMODELICALIBRARY"}
    return {**inherited, "HOME": str(home)}


def read_csv(file: Path) -> list[Row]:
    """The rows of a table; of several at one time, as events leave, only the last one."""
    with file.open(newline="") as lines:
        rows = [{name: float(v) for name, v in row.items()} for row in csv.DictReader(lines)]
    return list({next(iter(row.values())): row for row in rows}.values())


@dataclass(frozen=True)
class OpenModelica:
    """Libraries in OpenModelica.

    Attributes:
        folder: Where it writes.
        libraries: Folder with the library EtherCAT and a generated one.
        generated: Name of that one.
        old_front_end: Whether it translates with the front end of before 1.14, which it still has.
    """

    folder: Path
    libraries: Path
    generated: str = "TrollPlant"
    old_front_end: bool = False

    def run(self, *commands: str) -> str:
        """Runs commands after the libraries are loaded; returns what it says."""
        load = [
            'loadModel(Modelica, {"4.0.0"});',
            f'loadFile("{self.libraries}/EtherCAT/package.mo");',
            f'loadFile("{self.libraries}/{self.generated}/package.mo");',
        ]
        return self.script(*load, *commands, "getErrorString();")

    def script(self, *commands: str, home: Path | None = None) -> str:
        """Runs commands, in the home of another user if wanted; returns what it says."""
        file = self.folder / "script.mos"
        file.write_text("\n".join([*commands, ""]))
        done = subprocess.run(
            ["omc", *(["-d=nonewInst"] if self.old_front_end else []), file.name],
            cwd=self.folder,
            env=at_home(home) if home else None,
            capture_output=True,
            text=True,
            check=False,
        )
        return done.stdout + done.stderr

    def classes(self, library: str) -> list[str]:
        """All classes of a library that are no packages.

        The old front end does not check functions: for it only models and blocks.
        """
        wanted = "isModel(name) or isBlock(name)" if self.old_front_end else "not isPackage(name)"
        answer = self.run(
            f"names := getClassNames({library}, recursive = true, qualified = true);",
            "for name in names loop",
            f'  if {wanted} then print("@@ " + typeNameString(name) + "\\n"); end if;',
            "end for;",
        )
        return _CLASS.findall(answer)

    def findings(self, classes: Iterable[str]) -> Iterator[str]:
        """What `checkModel` does not like about classes."""
        commands = ["getErrorString();"]
        for name in classes:
            commands += [f'print("\\n@@ {name}\\n");', f"print(checkModel({name}));"]
            commands += ["print(getErrorString());"]
        answer = self.run(*commands)
        loading, *parts = re.split(r"^@@ ", answer, flags=re.MULTILINE)
        if "Warning:" in loading or "Error:" in loading:
            yield f"loading: {loading}"
        for part in parts:
            complaints = [
                line
                for line in part.splitlines()
                if re.search(r"Warning:|Error:", line) and not _EXPECTED.search(line)
            ]
            if complaints or "completed successfully" not in part:
                yield part

    def build(self, model: str) -> Path:
        """A program that simulates a model and writes its result as CSV."""
        answer = self.run(f'buildModel({model}, outputFormat = "csv");')
        program = self.folder / model
        assert not re.search(r"Error:|Warning:", answer), answer
        assert program.is_file(), answer
        return program

    def export(self, model: str) -> Path:
        """The model as a co-simulation FMU."""
        answer = self.run(f'buildModelFMU({model}, version = "2.0", fmuType = "cs");')
        fmus = list(self.folder.glob("*.fmu"))
        assert fmus, answer
        return fmus[0]


def start(
    program: Path, stop_time: float, flags: Sequence[str] = (), **overrides: str
) -> subprocess.Popen[str]:
    """Starts the program of a model; `bus` is the parameter of its EtherCATMaster.

    With two underscores in place of the point, `overrides` are values of any of its parameters.
    """
    values = {"stopTime": f"{stop_time}", "stepSize": "0.001"}
    values |= {name.replace("__", "."): value for name, value in overrides.items()}
    if bus := values.pop("bus", None):
        # A machine with other work may pause a program for longer than the usual lease.
        values = {"etherCATMaster.bus": bus, "etherCATMaster.lease": "10"} | values
    return subprocess.Popen(
        [
            str(program),
            "-override=" + ",".join(f"{name}={value}" for name, value in values.items()),
            f"-r={result_of(program)}",
            *flags,
        ],
        cwd=program.parent,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def result_of(program: Path) -> Path:
    """Where the program writes its result."""
    return program.with_name(f"{program.name}_res.csv")


def simulate(
    program: Path, stop_time: float, flags: Sequence[str] = (), **overrides: str
) -> list[Row]:
    """Runs the program of a model to its end; returns its result."""
    with start(program, stop_time, flags, **overrides) as process:
        log, _ = process.communicate()
    assert process.returncode == 0, log
    return read_csv(result_of(program))


def until(condition: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    """Waits, as long as a program runs, until something has come about."""
    while not condition():
        assert process.poll() is None, process.communicate()[0]
