"""Runs the experiment of Figures 8 and 9 of the paper on a simulated rig, from nothing to a plot.

Starts the rig and `ecatd` on it, generates the Modelica library of the bus, runs the experiment (by
OpenModelica where `omc` is on PATH, else by a C program that makes the calls of the model), plots
the result and shows how punctual the bus was. Everything it starts, it stops.
"""

from __future__ import annotations

import argparse
import csv
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
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
LIBRARY = "TrollPlant"


@dataclass(frozen=True)
class Experiment:
    """What distinguishes an experiment.

    Attributes:
        command: How it is started, for messages.
        rig: The simulated rig.
        program: The C program.
        model: Name of the Modelica model.
        file: File with the model; None: it is in the generated library.
        config: Configuration of `ecatd`; None: the defaults.
        options: Of `ecatctl generate`.
        picture: Name of the plot, without its suffix.
        title: What is plotted.
    """

    command: str
    rig: str
    program: Path
    model: str
    file: Path | None
    config: Path | None
    options: tuple[str, ...]
    picture: str
    title: str


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
def running_daemon(experiment: Experiment, bus: str) -> Iterator[None]:
    """`ecatd` on the simulated rig, from the moment it is in OP."""
    config = ("--config", str(experiment.config)) if experiment.config else ()
    with (
        tempfile.TemporaryDirectory(prefix="ecatd-demo-") as folder,
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ready,
    ):
        ready.bind(f"{folder}/notify")
        ready.settimeout(0.2)
        daemon = subprocess.Popen(
            [
                *(sys.executable, "-m", "ecatd.service", "--simulate", experiment.rig),
                *("--bus", bus),
                *config,
            ],
            env={**os.environ, "NOTIFY_SOCKET": f"{folder}/notify"},
            start_new_session=True,  # Ctrl-C is for this program, which then ends the daemon
        )
        try:
            _wait_ready(ready, daemon, f"{experiment.command} BUS=name")
            yield
        finally:
            if daemon.poll() is None:
                daemon.send_signal(signal.SIGTERM)
            daemon.wait()


def _wait_ready(ready: socket.socket, daemon: subprocess.Popen[bytes], other: str) -> None:
    """Waits for READY=1, as systemd does."""
    while True:
        try:
            if b"READY=1" in ready.recv(4096):
                return
        except TimeoutError:
            if daemon.poll() is not None:
                hint = f"; another bus name: {other}" if daemon.returncode == 7 else ""
                raise DemoError(f"ecatd ended with status {daemon.returncode}{hint}") from None


def run_in_c(experiment: Experiment, bus: str, seconds: float, out: Path) -> Path:
    """Builds and runs the C program; returns its record."""
    program, record = out / experiment.program.stem, out / f"{experiment.picture}.csv"
    library = out / "EtherCAT" / "Resources"
    (archive,) = (library / "Library").rglob("libecat.a")
    call(
        "gcc",
        "-O2",
        f"-I{library / 'Include'}",
        f"-I{library / 'Source' / 'standalone'}",
        f"-I{out / LIBRARY / 'Resources' / 'Source'}",
        experiment.program,
        archive,
        "-lm",
        "-o",
        program,
    )
    call(program, bus, str(seconds), record)
    return record


def run_in_openmodelica(experiment: Experiment, seconds: float, out: Path) -> Path:
    """Translates and simulates the model with `omc`; returns its record."""
    script = out / f"{experiment.picture}.mos"
    samples = round(seconds / 0.001)
    files = [out / "EtherCAT" / "package.mo", out / LIBRARY / "package.mo"]
    files += [experiment.file] if experiment.file else []
    load = "\n".join(
        f'if not loadFile("{file}") then print(getErrorString()); exit(1); end if;'
        for file in files
    )
    script.write_text(
        f"""\
if not loadModel(Modelica, {{"4.0.0"}}) then print(getErrorString()); exit(1); end if;
{load}
cd("{out}");
run := simulate({experiment.model}, stopTime = {seconds}, numberOfIntervals = {samples},
  outputFormat = "csv", variableFilter = "w_ref|w_m|i_m|age_m",
  fileNamePrefix = "{experiment.picture}");
messages := run.messages;
resultFile := run.resultFile;
print(messages);
print(getErrorString());
if resultFile == "" then exit(1); end if;
"""
    )
    call("omc", script)
    return out / f"{experiment.picture}_res.csv"


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
        if key == "delay" and not sum(stats["delay_cycles"]):
            continue  # no client has written outputs
        values = "".join(f"{row.get(name, 0):9.1f}" for name in ("p50", "p99", "p999", "max"))
        print(f"{title:<28}{values}")
    one, two, more = stats["delay_cycles"][1:]
    if total := one + two + more:
        share = 100 * one / total
        print(f"outputs left with the cycle after the sample that they answer: {share:.2f} %")


def print_age(record: Path) -> None:
    """How old the measured speed is, if it comes by messages."""
    with record.open(newline="") as lines:
        ages = sorted(float(row["age_m"]) for row in csv.DictReader(lines) if "age_m" in row)
    ages = [age for age in ages if age < 1e9]  # else there was none yet
    if ages:
        p50, p99 = (1e3 * ages[int(len(ages) * part)] for part in (0.5, 0.99))
        print(
            f"age of the measured speed in the samples: p50 {p50:.1f} ms, p99 {p99:.1f} ms, "
            f"max {1e3 * ages[-1]:.1f} ms"
        )


def demo(experiment: Experiment, bus: str, seconds: float, out: Path) -> None:
    """All steps."""
    out.mkdir(parents=True, exist_ok=True)
    out = out.resolve()
    picture = out / f"{experiment.picture}.png"
    picture.unlink(missing_ok=True)  # of an earlier record
    step(f"Starting the simulated rig '{experiment.rig}' and ecatd on it")
    with running_daemon(experiment, bus):
        step("The slaves on the bus (ecatctl slaves)")
        ctl(bus, "slaves")
        given = " ".join(("generate", LIBRARY, out.name, *experiment.options))
        step(f"Generating the Modelica library {LIBRARY} (ecatctl {given})")
        ctl(bus, "generate", LIBRARY, out, *experiment.options)
        omc = shutil.which("omc")
        how = (
            f"the model {experiment.model}, with {omc}"
            if omc
            else "a C program with the model's calls"
        )
        step(f"Running the experiment for {seconds:g} s at 1000 Hz: {how}")
        if omc:
            record = run_in_openmodelica(experiment, seconds, out)
        else:
            record = run_in_c(experiment, bus, seconds, out)
        stats = json.loads(ctl(bus, "stats", "--json", quiet=True))
        if experiment.config:
            step("The CAN buses (ecatctl can stats)")
            ctl(bus, "can", "stats")
    step("Plotting reference speed, measured speed and current")
    call(sys.executable, HERE / "plot.py", record, picture, "--title", experiment.title)
    step("Timing of the bus")
    print_summary(stats)
    print_age(record)
    model = experiment.file or out / LIBRARY / "package.mo"
    step(f"Done: look at {picture}, open {model} in OpenModelica")


def main(experiment: Experiment) -> int:
    """Runs the demo; returns the exit status."""
    parser = argparse.ArgumentParser(description=experiment.title)
    parser.add_argument("--out", type=Path, default=Path("demo"), metavar="DIR")
    parser.add_argument("--seconds", type=float, default=10.0, metavar="S")
    parser.add_argument("--bus", default="ecat0", metavar="NAME")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        demo(experiment, options.bus, options.seconds, options.out)
    except DemoError as error:
        print(f"demo: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\ndemo: interrupted; everything that was started is stopped", file=sys.stderr)
        return 130
    return 0
