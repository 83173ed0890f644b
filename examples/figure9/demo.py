"""`make demo`: the experiment of Figures 8 and 9 of the paper, from nothing to a plot.

Starts the simulated rig `troll` and `ecatd` on it, generates the Modelica library of the bus, runs
the library's example (by OpenModelica where `omc` is on PATH, else by a C program that makes the
same calls), plots the result and shows how punctual the bus was. Everything it starts, it stops.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
LIBRARY = "TrollPlant"
EXAMPLE = f"{LIBRARY}.Examples.PointToPointMovement"


class DemoError(Exception):
    """A step that did not work; what it printed has told why."""


def step(text: str) -> None:
    """Says what happens now."""
    print(f"\n==> {text}", flush=True)


def call(*command: str | Path, quiet: bool = False) -> str:
    """Runs a command; its output is shown, or returned if `quiet`."""
    result = subprocess.run(
        [str(part) for part in command],
        stdout=subprocess.PIPE if quiet else None,
        text=True,
        check=False,
    )
    if result.returncode != 0:
        raise DemoError(f"{Path(str(command[0])).name} ended with status {result.returncode}")
    return result.stdout or ""


def ctl(bus: str, *arguments: str | Path, quiet: bool = False) -> str:
    """Runs `ecatctl`."""
    return call(sys.executable, "-m", "ecatd.cli", *arguments, "--bus", bus, quiet=quiet)


@contextmanager
def running_daemon(bus: str) -> Iterator[None]:
    """`ecatd` on the simulated rig, from the moment it is in OP."""
    with (
        tempfile.TemporaryDirectory(prefix="ecatd-demo-") as folder,
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ready,
    ):
        ready.bind(f"{folder}/notify")
        ready.settimeout(0.2)
        daemon = subprocess.Popen(
            [sys.executable, "-m", "ecatd.service", "--simulate", "troll", "--bus", bus],
            env={**os.environ, "NOTIFY_SOCKET": f"{folder}/notify"},
            start_new_session=True,  # Ctrl-C is for this program, which then ends the daemon
        )
        try:
            _wait_ready(ready, daemon)
            yield
        finally:
            if daemon.poll() is None:
                daemon.send_signal(signal.SIGTERM)
            daemon.wait()


def _wait_ready(ready: socket.socket, daemon: subprocess.Popen[bytes]) -> None:
    """Waits for READY=1, as systemd does."""
    while True:
        try:
            if b"READY=1" in ready.recv(4096):
                return
        except TimeoutError:
            if daemon.poll() is not None:
                hint = "; another bus name: make demo BUS=name" if daemon.returncode == 7 else ""
                raise DemoError(f"ecatd ended with status {daemon.returncode}{hint}") from None


def run_in_c(bus: str, seconds: float, out: Path) -> Path:
    """Builds and runs the C program; returns its record."""
    program, record = out / "figure9", out / "figure9.csv"
    library = out / "EtherCAT" / "Resources"
    (archive,) = (library / "Library").rglob("libecat.a")
    call(
        "gcc",
        "-O2",
        f"-I{library / 'Include'}",
        f"-I{library / 'Source' / 'standalone'}",
        f"-I{out / LIBRARY / 'Resources' / 'Source'}",
        HERE / "figure9.c",
        archive,
        "-lm",
        "-o",
        program,
    )
    call(program, bus, str(seconds), record)
    return record


def run_in_openmodelica(seconds: float, out: Path) -> Path:
    """Translates and simulates the example model with `omc`; returns its record."""
    script = out / "figure9.mos"
    samples = round(seconds / 0.001)
    script.write_text(
        f"""\
if not loadModel(Modelica, {{"4.0.0"}}) then print(getErrorString()); exit(1); end if;
if not loadFile("{out}/EtherCAT/package.mo") then print(getErrorString()); exit(1); end if;
if not loadFile("{out}/{LIBRARY}/package.mo") then print(getErrorString()); exit(1); end if;
cd("{out}");
run := simulate({EXAMPLE}, stopTime = {seconds}, numberOfIntervals = {samples},
  outputFormat = "csv", variableFilter = "w_ref|w_m|i_m", fileNamePrefix = "figure9");
messages := run.messages;
resultFile := run.resultFile;
print(messages);
print(getErrorString());
if resultFile == "" then exit(1); end if;
"""
    )
    call("omc", script)
    return out / "figure9_res.csv"


def print_summary(stats: dict[str, Any]) -> None:
    """The timing of the bus during the demo."""
    real_time = stats["realtime"]["scheduling"]
    print(f"cycle {stats['cycle_time_us']:g} µs, {real_time}")
    print(
        f"{stats['cycles']} cycles, {stats['missed']} missed, {stats['lost']} frames not back in "
        f"their cycle"
    )
    print(f"{'times in µs':<28}{'p50':>9}{'p99':>9}{'p99.9':>9}{'max':>9}")
    for key, title in (
        ("exchange", "exchange with the slaves"),
        ("wakeup", "wake-up after deadline"),
        ("delay", "sample-to-bus delay"),
    ):
        row = stats[key]
        values = "".join(f"{row.get(name, 0):9.1f}" for name in ("p50", "p99", "p999", "max"))
        print(f"{title:<28}{values}")
    one, two, more = stats["delay_cycles"][1:]
    total = max(1, one + two + more)
    print(
        f"outputs left with the cycle after the sample that they answer: {100 * one / total:.2f} %"
    )


def demo(bus: str, seconds: float, out: Path) -> None:
    """All steps."""
    out.mkdir(parents=True, exist_ok=True)
    out = out.resolve()
    (out / "figure9.png").unlink(missing_ok=True)  # of an earlier record
    step("Starting the simulated rig 'troll' and ecatd on it")
    with running_daemon(bus):
        step("The slaves on the bus (ecatctl slaves)")
        ctl(bus, "slaves")
        step(f"Generating the Modelica library {LIBRARY} (ecatctl generate {LIBRARY} {out.name})")
        ctl(bus, "generate", LIBRARY, out)
        omc = shutil.which("omc")
        how = f"the model {EXAMPLE}, with {omc}" if omc else "a C program with the model's calls"
        step(f"Running the experiment for {seconds:g} s at 1000 Hz: {how}")
        record = run_in_openmodelica(seconds, out) if omc else run_in_c(bus, seconds, out)
        stats = json.loads(ctl(bus, "stats", "--json", quiet=True))
    step("Plotting reference speed, measured speed and current")
    call(sys.executable, HERE / "plot.py", record, out / "figure9.png")
    step("Timing of the bus")
    print_summary(stats)
    step(
        f"Done: look at {out / 'figure9.png'}, open {out / LIBRARY / 'package.mo'} in OpenModelica"
    )


def main() -> int:
    """Runs the demo; returns the exit status."""
    parser = argparse.ArgumentParser(description="Runs the experiment of the paper's Figure 9.")
    parser.add_argument("--out", type=Path, default=Path("demo"), metavar="DIR")
    parser.add_argument("--seconds", type=float, default=10.0, metavar="S")
    parser.add_argument("--bus", default="ecat0", metavar="NAME")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        demo(options.bus, options.seconds, options.out)
    except DemoError as error:
        print(f"demo: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\ndemo: interrupted; everything that was started is stopped", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
