"""Incidents: what the flight recorder writes about faults, lapses, conditions and requests."""

import itertools
import json
import os
import re
import signal
import struct
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path

import pytest
from test_web import HAS_PAGE, serving

from conftest import Daemon, names, one_line_error, wait_for
from ecatd.base.addresses import parse_address
from ecatd.base.errors import EcatError
from ecatd.base.incident_file import IncidentFile
from ecatd.operations.incident_files import incidents
from ecatd.web.file_source import FileSource
from ecatsim.control import Simulator
from ecatsim.replay import Replay
from ecatsim.rigs import library as rigs

pytestmark = pytest.mark.bus
pytest.importorskip("mcap")
read_csv = pytest.importorskip("fmpy.util").read_csv

SETTINGS = """
[flight_recorder]
folder = "{folder}"
before_s = 0.5
after_s = 0.5
{more}
"""


def found(folder: Path, daemon: Daemon, trigger: str) -> Path:
    """The first incident with a trigger of this kind, when it has been written."""

    def of_this_kind() -> list[str]:
        return [i["name"] for i in incidents(folder, daemon.bus) if i["trigger"] == trigger]

    wait_for(of_this_kind, daemon)
    return folder / of_this_kind()[0]


def test_a_fault_and_a_request(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    folder = tmp_path / "new" / "incidents"
    umask = partial(os.umask, 0o077)  # that of the service
    daemon = start_daemon("troll", config=SETTINGS.format(folder=folder, more=""), preexec=umask)
    wait_for(folder.is_dir, daemon)
    (folder / "mine.mcap").touch()
    wait_for(lambda: daemon.ctl_json("stats")["cycles"] > 150, daemon)
    asked = daemon.ctl_json("incident", "record", "just to see")
    assert (asked["trigger"], "just to see" in asked["reason"]) == ("request", True)
    assert asked["cycles"] > 100
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        simulator.faults.power_off(5)
        path = found(folder, daemon, "fault")
    modes = [item.stat().st_mode & 0o777 for item in (folder.parent, folder, path)]
    assert modes == [0o750, 0o750, 0o640]
    file = IncidentFile(path)
    rows = [values for _, values in file.cycles()]
    numbers = [values["cycle"] for values in rows]
    assert numbers == sorted(set(numbers))
    gaps = sum(b - a - 1 for a, b in itertools.pairwise(numbers))
    assert gaps == sum(values["missing_before"] for values in rows)
    before = [values for values in rows if not values["incomplete_domains"]]
    after = [values for values in rows if values["incomplete_domains"]]
    assert before[0]["cycle"] < after[0]["cycle"]
    assert all(values["exchange_us"] >= 0 for values in rows)
    inputs = [item for item in file.signals if item["slave"] == 5 and not item["output"]]
    of_five = [item["field"] for item in inputs]
    assert all(before[0][name] is not None for name in of_five)
    assert all(after[-1][name] is None for name in of_five)
    names(file.attachment("reading.txt").decode(), "slave 5", f"(cycle {after[0]['cycle']})")
    assert set(file.sizes) >= {
        "frames.pcapng", "bus.json", "configuration.json", "log.txt", "events.json",
        "statistics.json",
    }  # fmt: skip
    times = {values["cycle"]: at_ns for at_ns, values in file.cycles()}
    events = json.loads(file.attachment("events.json"))
    placed = [item for item in events if item.get("cycle") in times]
    assert all(item["time_ns"] == times[item["cycle"]] for item in placed)
    kinds = {item["event"] for item in placed if item["cycle"] >= before[-1]["cycle"]}
    assert kinds >= {"working_counter", "slaves", "al_state"}
    assert struct.unpack_from("<I", file.attachment("frames.pcapng"))[0] == 0x0A0D0D0A

    listed = daemon.ctl_json("incident", "list")["incidents"]
    assert path.name in [item["name"] for item in listed]
    log = file.attachment("log.txt").decode().splitlines()
    assert all(re.match(r"\d{4}(-\d\d){2}T(\d\d:){2}\d\d\.\d{6}Z \w+: ", line) for line in log)
    assert "mine.mcap" not in [item["name"] for item in listed]
    assert "slave 5" in daemon.ctl("incident", "show", path.name).stdout
    for suffix in ("mcap", "pcapng", "csv", "txt", "json"):
        daemon.ctl("incident", "export", path.name, "-o", str(tmp_path / f"out.{suffix}"))
    assert (tmp_path / "out.mcap").read_bytes() == path.read_bytes()
    columns = read_csv(tmp_path / "out.csv").dtype.names
    assert columns[:2] == ("time", "cycle")
    assert "el3008_2.valid" in columns
    assert sum(not name.endswith("valid") for name in columns) == 3 + len(file.signals)
    assert columns[-1] == "unix_s"
    chosen = inputs[0]
    rig = rigs.make("troll")
    Replay(tmp_path / "out.mcap", rig)
    rig.devices[5].give()  # the replay begins
    key = parse_address(chosen["address"])
    assert key is not None
    assert rig.devices[5].dictionary.mapped(*key).value == rows[0][chosen["raw"]]
    (tmp_path / "apart").mkdir()
    daemon.ctl("incident", "export", path.name, "-o", str(tmp_path / "apart" / "Out.mo"))
    assert (tmp_path / "apart" / "Out.txt").read_text() == (tmp_path / "out.txt").read_text()
    if HAS_PAGE:
        look_in_the_browser(daemon, tmp_path / "out.mcap", file, rows)
    daemon.ctl("incident", "delete", path.name)
    assert not path.exists()
    for name in (path.name, "../x.mcap", "mine.mcap"):
        refused = daemon.ctl("incident", "delete", name, check=False)
        names(one_line_error(refused.stderr, "ecatctl"), name, "incident list")


def look_in_the_browser(
    daemon: Daemon, path: Path, file: IncidentFile, rows: list[Mapping[str, float | None]]
) -> None:
    """The page shows what the file has: each value exact, or as an old one."""
    fields = {f"{item['slave']}/{item['address']}": item["raw"] for item in file.signals}
    name = next(item for item in fields if item.startswith("5/"))
    with serving(daemon, str(path)) as web, web.open() as page:
        assert page.of_type("hello")["source"] == "file"
        names(page.of_type("link")["text"], "incident", daemon.bus)
        signals = {item["name"]: item for item in page.of_type("signals")["signals"]}
        assert set(signals) == set(fields)
        assert signals[name]["label"].startswith("EL3008/")
        assert page.value("ro/slaves")["value"]["slaves"][5]["name"] == "EL3008"
        assert page.value("ro/state")["value"]["slaves"]
        statistics = page.value("ro/stats")["value"]
        assert page.value("ro/config")["value"]["config"]["flight_recorder"]["before_s"] == 0.5
        reading = page.value("reading")["value"]["text"]
        assert reading == file.attachment("reading.txt").decode()
        lamps = {lamp["id"]: lamp["state"] for lamp in page.of_type("lamps")["lamps"]}
        assert "outputs" not in lamps  # nobody knows who owned them
        assert lamps["slaves_in_op"] == "bad"
        events = page.of_type("events")["events"]
        assert any(event["event"] == "working_counter" for event in events)
        assert page.ask("ro/stats", buckets=True)["answer"] == statistics
        page.say(type="trace", signals=[name], generation=1)
        header, cycles = page.batch(1)
        while cycles[-1] != rows[-1]["cycle"]:
            header, more = page.batch(1)
            cycles += more
        assert cycles == [row["cycle"] for row in rows]
        assert header["columns"][0]["type"] == signals[name]["type"]
        assert header["count"] - 1 in header["invalid"][0][1:]  # slave 5 has no power
        page.of_type("end")
    damaged = path.with_name("damaged.mcap")
    whole = path.read_bytes()
    damaged.write_bytes(whole[: len(whole) // 2])
    try:
        told = FileSource(damaged)._contents.about
    except EcatError as error:  # no chunk is whole
        told = str(error)
    names(told, "damaged.mcap ends in the middle")
    damaged.write_bytes(whole[:-1])
    assert FileSource(damaged)._contents.about == FileSource(path)._contents.about
    for size in (0, 7, 100):
        damaged.write_bytes(whole[:size])
        with pytest.raises(EcatError, match=r"damaged\.mcap"):
            FileSource(damaged)
    refused = daemon.ctl("web", "--no-browser", str(damaged), check=False)
    names(one_line_error(refused.stderr, "ecatctl"), "damaged.mcap")
    for at in range(len(whole) - 9000, len(whole), 300):  # where the file says what is where
        damaged.write_bytes(
            whole[:at] + bytes(~byte & 0xFF for byte in whole[at : at + 3]) + whole[at + 3 :]
        )
        with suppress(EcatError):
            FileSource(damaged)


def test_a_condition_that_would_not_be_used_is_wrong(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    daemon = start_daemon("troll")
    file = tmp_path / "rec.toml"

    def check(signal: str, folder: Path | str = tmp_path) -> tuple[int, str]:
        more = f'[[flight_recorder.condition]]\nsignal = "{signal}"\nabove = 1\n'
        file.write_text(SETTINGS.format(folder=folder, more=more))
        done = daemon.ctl("config", "check", str(file), check=False)
        return done.returncode, done.stdout

    for fits in ("4/AI Standard Channel 1/Value", "4/0x6000:11"):
        assert check(fits)[0] == 0, check(fits)
    status, said = check("4/Channel 1/Value")
    assert status == 2
    names(said, "rec.toml:7: flight_recorder.condition[0].signal", "no entry", "`ecatctl read`")
    status, said = check("*/*")
    assert status == 2
    names(
        said,
        "flight_recorder.condition[0].signal",
        "entries of this bus fit '*/*'",
        "for each value",
    )
    status, said = check("4/0x6000:11", "")
    assert status == 2
    names(said, "flight_recorder.condition[0].signal", "flight_recorder.folder is empty")


def test_conditions_lapses_and_the_end_of_the_recorder(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    """The recorder dies, and the bus goes on with another one; the disk is bounded."""
    more = """
faults = false
[[flight_recorder.condition]]
signal = "0/0x7000:01"
above = 100
[[flight_recorder.condition]]
signal = "0/nosuch"
below = 0
"""
    daemon = start_daemon("line:1", config=SETTINGS.format(folder=tmp_path / "x", more=more))
    wait_for(lambda: "flight_recorder.condition[1].signal" in daemon.log, daemon)
    looked = json.loads(daemon.ctl("check", "--json", check=False).stdout)
    told = [text for text in looked["problems"] if "condition" in text]
    assert len(told) == 1
    assert looked["status"] != "well"
    for text in (*told, *daemon.ctl_json("info")["unused_conditions"]):
        names(text, "flight_recorder.condition[1].signal", "'0/nosuch'", "not used", "ecatctl read")
    half = tmp_path / "x" / f"{daemon.bus}-20260101T000000.000000Z.part"
    half.touch()
    os.kill(daemon.child_pid("ecatd.recorder"), signal.SIGKILL)
    wait_for(lambda: "the flight recorder has ended" in daemon.log, daemon)
    wait_for(lambda: daemon.log.count("flight_recorder.condition[1].signal") == 2, daemon)
    assert not half.exists()
    client = daemon.client()
    output = client.signal("0/0x7000:01")
    claim = client.claim([output], lease=50)
    assert claim
    output.raw = 7
    client.commit()
    wait_for(lambda: daemon.ctl("read", "0/0x7000:01").stdout, daemon)
    for value in (101, 3, 102):
        output.raw = value
        client.commit()
        client.wait()
        client.sample()
    path = found(tmp_path / "x", daemon, "condition")
    (signal_,) = (item for item in IncidentFile(path).signals if item["address"] == "0x7000:01")
    values = [row[signal_["field"]] for _, row in IncidentFile(path).cycles()]
    assert {7, 101} <= {*values}
    names(IncidentFile(path).attachment("reading.txt").decode(), "was 101, above 100")
    client.sample()
    claim = client.claim([output], lease=50)
    output.raw = 9
    client.commit()  # and then the client hangs
    lapse = IncidentFile(found(tmp_path / "x", daemon, "lapse"))
    assert "(lapse)" in lapse.attachment("reading.txt").decode()
    client.close()
