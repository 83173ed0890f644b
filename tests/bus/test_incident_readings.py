"""The first reading of incidents: what an engineer would say who has looked at everything."""

import re
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon, wait_for
from ecatd.base.incident_file import IncidentFile
from ecatd.operations.incident_files import incidents
from ecatsim.control import Simulator

pytestmark = [pytest.mark.bus, pytest.mark.long]
pytest.importorskip("mcap")

SETTINGS = """
[flight_recorder]
folder = "{folder}"
before_s = 0.4
after_s = 1.0
per_hour = 1000
[[flight_recorder.condition]]
signal = "3/0x7000:01"
above = 0.5
pause_s = 0
"""
CLOCK = r"\d\d:\d\d:\d\d\.\d{3} \(cycle \d+\) "
LATER = r"  (\d+ cycles? later( \([\d.]+ s\))?|in the same cycle): "


class Readings:
    """The incidents of a daemon, as far as nobody has looked at them."""

    def __init__(self, folder: Path, daemon: Daemon) -> None:
        self.folder, self.daemon = folder, daemon
        self.seen: set[str] = set()

    def with_a(self, pattern: str) -> str:
        """The next reading with a line that fits. A busy machine makes incidents of its own."""
        found: list[str] = []

        def look() -> bool:
            for item in incidents(self.folder, self.daemon.bus):
                if item["name"] not in self.seen:
                    self.seen.add(item["name"])
                    file = IncidentFile(self.folder / item["name"])
                    reading = file.attachment("reading.txt").decode()
                    assert not re.search(r"\b(now|ago|in the last)\b", reading), reading
                    found.append(reading)
            return any(re.search(pattern, text, re.MULTILINE) for text in found)

        try:
            wait_for(look, self.daemon)
        except BaseException:
            print("\n".join(found))
            raise
        return next(text for text in found if re.search(pattern, text, re.MULTILINE))

    def settle(self) -> None:
        """Waits until the bus is well, and what has happened belongs to the past."""
        wait_for(lambda: self.daemon.ctl("check", check=False).returncode == 0, self.daemon)
        time.sleep(2)


def test_an_input_that_drifts_is_told_and_a_healthy_bus_has_nothing_to_tell(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    settings = SETTINGS.replace("before_s = 0.4", "before_s = 4").partition("[[flight")[0]
    daemon = start_daemon("troll", config=settings.format(folder=tmp_path / "x"))
    readings = Readings(tmp_path / "x", daemon)
    changed = r"(\d\d:){2}\d\d\.\d{3} \(cycle \d+\) \d/.* changed from "
    with (
        Simulator(str(daemon.child_pid("ecatsim"))) as simulator,
        daemon.client() as client,
        client.claim(client.signal(3, 0x7000, 1), lease=50),
    ):
        readings.settle()

        def run(seconds: float) -> None:
            """A machine whose outputs and inputs move."""
            output, inputs = client.signal(3, 0x7000, 1), [(2, 0x6000, 1), (4, 0x6010, 0x11)]
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                output.raw = not output.raw
                client.commit()
                for number, place in enumerate(inputs):
                    simulator.set(*place, int(output.raw) * 500**number)
                client.sample()
                time.sleep(0.01)

        run(5)
        daemon.ctl("incident", "record", "healthy")
        assert not re.search(changed, readings.with_a("request"), re.MULTILINE)
        run(3)
        simulator.faults.drift(5, "0x6040:11", -2000)
        run(1)
        daemon.ctl("incident", "record", "drift")
        text = readings.with_a("asked for an incident: drift")
        assert re.search(
            changed + r"1(\.\d+)? V to -?\d+\.\d+ V within \d\.\d{3} s; no output of its slave "
            "changed in the second before$",
            text,
            re.MULTILINE,
        ), text
        assert text.count(" changed from ") == 1, text


def test_readings(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    daemon = start_daemon("troll", config=SETTINGS.format(folder=tmp_path / "x"))
    readings = Readings(tmp_path / "x", daemon)
    wait_for(readings.folder.is_dir, daemon)
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        readings.settle()
        simulator.faults.break_link(5)
        text = readings.with_a(rf"^{CLOCK}slave count changed from 8 to 5.*behind slave 4")
        for line in (
            rf"^{LATER}slaves 5 \(EL3008\), 6 \(EL6751\) and 7 \(EL6751\): no answer$",
            rf"^{LATER}slaves 5 \(EL3008\), 6 \(EL6751\) and 7 \(EL6751\): left OP$",
            rf"^{LATER}the working counter was wrong \(1 domain\)$",
        ):
            assert re.search(line, text, re.MULTILINE), text
        simulator.faults.heal_link(5)
        readings.settle()

        simulator.faults.al_error(4, 0x001D)
        text = readings.with_a(rf"^{CLOCK}slave 4 \(EL3008\): .*0x001D: .*output.*")
        assert re.search(rf"^{LATER}slave 4 \(EL3008\): left OP", text, re.MULTILINE), text
        daemon.ctl("state", "4", "OP", check=False)
        readings.settle()

        simulator.faults.drop(count=3)
        # The cable that was broken before may be named as its cause.
        lost = r"1 frame did not come back \(1 domain\)$"
        readings.with_a(rf"{lost}\n  3 cycles later: the exchanges .* complete again$")
        readings.settle()

    daemon.ctl("incident", "record", "the noise again")
    text = readings.with_a(r"\(request\): .* has asked for an incident: the noise again\.$")
    assert "No fault of the bus is known" in text or "missing" in text, text
    readings.settle()

    daemon.ctl("write", "3/0x7000:01=1", "--for", "0.1", "--yes")
    text = readings.with_a(r"\(condition\)")
    assert re.search(
        rf"^{CLOCK}'\w+' \(pid \d+\) owns outputs of slave 3 .*\n{LATER}3/.* was 1, above 0.5$",
        text,
        re.MULTILINE,
    ), text
    readings.settle()

    client = daemon.client()
    output = client.signal("3/0x7010:01")
    client.sample()
    claim = client.claim([output], lease=50)
    output.raw = 1
    client.commit()  # and then the client hangs
    assert claim
    readings.with_a(rf"^{CLOCK}outputs of slave 3 \(EL2008\) are safe: .*pid \d+")
    client.close()
