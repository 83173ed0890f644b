"""Virtual ECUs that send anything to the bus simulation FMU, with sanitizers."""

import json
import re
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from mutations import inputs

from conftest import Daemon

pytestmark = pytest.mark.long

IMPORTER = Path(__file__).parent / "ls_bus" / "importer.c"
CYCLE_TIME_US = 1000
CONFIG = """[gateway]
listen = []
[[slave]]
position = 6
[slave.can]
bit_rate = 1000
identifiers = 29
frames_per_second = 3000
"""


@pytest.mark.parametrize("where", ["on a bus", "without one"])
def test_an_ecu_sends_anything(
    where: str, start_daemon: Callable[..., Daemon], tmp_path: Path, compiler: str
) -> None:
    daemon = start_daemon("troll-can", config=CONFIG)
    daemon.ctl("generate", "CanBus", str(tmp_path), "--ls-bus", "6", "--ls-bus-ecus", "2")
    fmu = tmp_path / "fmu"
    with zipfile.ZipFile(tmp_path / "CanBus.fmu") as archive:
        archive.extractall(fmu)
    table = (fmu / "resources" / "plant.txt").read_text()
    (token,) = re.findall(r"^token (.+)$", table, re.M)
    variables = re.findall(r"^variable \S+ \S+ \S+ (\S+)", table, re.M)
    program = tmp_path / "importer"
    flags = ["-g", "-O1", "-D_GNU_SOURCE", f"-I{fmu / 'sources'}", "-Wall", "-Werror"]
    flags += ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    sources = [str(path) for path in sorted((fmu / "sources").rglob("*.c"))]
    subprocess.run(
        [compiler, *flags, str(IMPORTER), *sources, "-lm", "-o", str(program)], check=True
    )
    on_bus = where == "on a bus"
    result = subprocess.run(
        [
            *(str(program), str(fmu / "resources"), token, daemon.bus if on_bus else "-"),
            *(str(variables.index("Ecu1.Rx_Clock")), str(inputs(20_000)), "1"),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (result.returncode, result.stderr) == (0, "")
    found = json.loads(result.stdout)
    assert found["format_errors"] > 10_000
    assert (found["confirms"] > 0) == on_bus
    assert (found["bus_errors"] > 0) == (not on_bus)
    assert 0 < found["warnings"] < 100  # a hostile ECU cannot fill the log
    if on_bus:
        with daemon.client() as client:  # and the bus goes on
            client.wait()
