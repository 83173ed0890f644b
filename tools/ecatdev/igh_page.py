"""Writes docs/from-igh.md: commands of IgH's `ethercat`, those of `ecatctl`, and their output.

    PYTHONPATH=tools python -m ecatdev.igh_page docs/from-igh.md

The outputs are those of simulated rigs, so no hardware is needed.
"""

from __future__ import annotations

import contextlib
import os
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

_ROOT = Path(__file__).parents[2]
_FILES_RIG = _ROOT / "tests" / "rigs" / "files.py"
_EOE_RIG = _ROOT / "tests" / "rigs" / "ethernet.py"
_LINES_MOST, _WIDTH_MOST = 12, 110

_INTRO = """\
# Coming from IgH

IgH's EtherCAT Master has a command `ethercat` with 34 subcommands. For each of them, the table has
the command of `ecatctl`, or what to use instead. Below the table are examples on simulated rigs,
with all that they print: nothing, if the command only writes a value. Long outputs are cut: `…`
ends a line that goes on, and `...` stands for further lines.

[Command line](command-line.md#ecatctl) explains all commands, and says which of them ask the daemon
of another machine (`--connect`) and print JSON (`--json`).
"""


class Row(NamedTuple):
    """A command of IgH.

    Attributes:
        igh: Its name.
        ours: The command of `ecatctl`; empty if there is none.
        remark: The difference, or the reason why there is none.
        run: The command that is shown; empty for none.
        rig: The rig on which it runs.
    """

    igh: str
    ours: str
    remark: str
    run: str = ""
    rig: str = "troll"


ROWS = (
    Row("master", "info", "also which real time the daemon was granted", "info"),
    Row("slaves", "slaves", "", "slaves"),
    Row(
        "config",
        "config show",
        "`config init` writes a configuration of the bus as it is",
        "config show",
    ),
    Row("domains", "stats", "working counters, timing and lost frames of each domain", "stats"),
    Row("version", "--version", "", "--version"),
    Row("graph", "graph", "a tree; `-o bus.svg` or `-o bus.dot` draws it", "graph"),
    Row("debug", "log-level", "by part of the daemon", "log-level mailbox"),
    Row("pdos", "pdos", "with units, and the position in the process image", "pdos 3"),
    Row("data", "read", "values with their units, by name patterns", "read '4/*Value'"),
    Row("cstruct", "cstruct", "a struct for each domain", "cstruct"),
    Row("xml", "xml", "", "xml"),
    Row("sdos", "sdos", "the daemon keeps the descriptions", "sdos 4 --values"),
    Row(
        "upload",
        "sdo-read",
        "the type need not be given; also called `upload`",
        "sdo-read 0 0x6060",
    ),
    Row("download", "sdo-write", "also called `download`", "sdo-write 4 0x8000 0x06 1"),
    Row("states", "state", "`state 3 PREOP` requests a state; it asks first", "state"),
    Row(
        "rescan",
        "rescan",
        "only looks; a restart of the daemon uses the bus as it is now",
        "rescan",
    ),
    Row("reboot", "reboot", "waits until the slave is back", "reboot 3 --yes"),
    Row("crc", "errors", "which cable it is, in words", "errors"),
    Row("diag", "errors --all", "", "errors --all 1"),
    Row(
        "pcap",
        "capture",
        "from memory that is always on, in both directions",
        "capture -o last.pcapng",
    ),
    Row("reg_read", "reg-read", "by number or name", "reg-read 2 al_status"),
    Row("reg_write", "reg-write", "asks first", "reg-write 2 0x0410 1000 --yes"),
    Row(
        "reg_rdwr", "reg-write", "prints what the registers have afterwards, read by a second frame"
    ),
    Row("sii_read", "sii-read", "`-o FILE` saves the bytes", "sii-read 4"),
    Row(
        "sii_write",
        "sii-write",
        "shows the difference, asks, keeps the bytes before",
        "sii-write 4 el3008.bin",
    ),
    Row("alias", "alias", "", "alias 3 7 --yes"),
    Row("foe_read", "foe-read", "", "foe-read 0 parameters.bin -o parameters.bin", str(_FILES_RIG)),
    Row(
        *("foe_write", "foe-write", "`--boot` brings the slave to BOOT and back"),
        *("foe-write 0 firmware.efw --boot --yes", str(_FILES_RIG)),
    ),
    Row("soe_read", "soe-read", "with name and unit", "soe-read 1", str(_FILES_RIG)),
    Row("soe_write", "soe-write", "", "soe-write 1 S-0-0001 2500", str(_FILES_RIG)),
    Row("eoe", "eoe", "frames of each slave; one interface for all of them", "eoe", str(_EOE_RIG)),
    Row("eoe_addif", "", "`[eoe]` in the configuration names the interface"),
    Row("eoe_delif", "", "the interface ends with ecatd"),
    Row(
        *("ip", "eoe-write", "`[slave.eoe]` in the configuration gives them at each start"),
        *("eoe-write 1 --address 192.168.7.2/24", str(_EOE_RIG)),
    ),
)
"""All commands, in the order of IgH's tool."""


def table() -> str:
    """Returns the table of all commands."""
    lines = ["| `ethercat` | `ecatctl` | |", "|---|---|---|"]
    lines += [f"| `{r.igh}` | {f'`{r.ours}`' if r.ours else '–'} | {r.remark} |" for r in ROWS]
    return "\n".join(lines)


def shown(text: str) -> str:
    """An output as the page shows it: what is cut has a mark."""
    lines = text.rstrip().splitlines()
    kept = [
        line if len(line) <= _WIDTH_MOST else line[: _WIDTH_MOST - 1].rstrip() + "…"
        for line in map(str.rstrip, lines[:_LINES_MOST])
    ]
    return "\n".join([*kept, *(["..."] if len(lines) > _LINES_MOST else [])])


@contextlib.contextmanager
def _daemon(rig: str, folder: Path) -> Iterator[dict[str, str]]:
    """Runs a daemon on a rig, and yields the environment of its clients."""
    environment = {**os.environ, "ECATD_RUNTIME_DIR": str(folder / "run"), "ECATD_BUS": "ecatp"}
    config = folder / "ecat.toml"
    config.write_text(
        '[gateway]\nlisten = []\n[eoe]\ninterface = "eoe0"\naddress = "192.168.7.1/24"\n'
    )
    command = [sys.executable, "-m", "ecatd.service", "--simulate", rig]
    command += ["--bus", "ecatp", "--config", str(config)]
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) as daemon:
        assert daemon.stderr is not None
        for line in daemon.stderr:
            if "is in OP" in line:
                break
        try:
            yield environment
        finally:
            daemon.terminate()
            daemon.communicate()


def _outputs(rig: str, rows: list[Row]) -> Iterator[tuple[Row, str]]:
    with tempfile.TemporaryDirectory() as scratch, _daemon(rig, Path(scratch)) as environment:
        folder = Path(scratch)
        (folder / "firmware.efw").write_bytes(bytes(100_000))

        def run(text: str) -> str:
            done = subprocess.run(
                [sys.executable, "-m", "ecatd.cli", *shlex.split(text)],
                env=environment,
                cwd=folder,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                check=False,
            )
            if done.returncode:
                raise SystemExit(f"ecatctl {text}: {done.stdout}")
            return done.stdout

        if rig == "troll":
            run("sii-read 4 -o el3008.bin")
        for row in rows:
            yield row, run(row.run)


def page() -> str:
    """Returns the whole page."""
    parts = [_INTRO, table(), ""]
    outputs: dict[str, str] = {}
    for rig in dict.fromkeys(row.rig for row in ROWS):
        mine = [row for row in ROWS if row.rig == rig and row.run]
        outputs |= {row.igh: shown(text) for row, text in _outputs(rig, mine)}
    for row in ROWS:
        if row.igh in outputs:
            lines = [f"$ ecatctl {row.run}", *filter(None, [outputs[row.igh]])]
            parts += [f"## {row.igh}", "", "```", *lines, "```", ""]
    return "\n".join(parts).replace("ecatp", "ecat0")


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(page())
