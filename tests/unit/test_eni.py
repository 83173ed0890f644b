"""ENI files become configurations; what does not is named."""

import tomllib
from pathlib import Path

import pytest
from eni_sample import MACHINE, coe, command, eni, fmmu, ids, slave, task
from hypothesis import given
from hypothesis import strategies as st

from conftest import names, naming
from ecatd.base.errors import ConfigError
from ecatd.config import read_config
from ecatd.config.clocks import DcSlaveConfig
from ecatd.config.config import Config
from ecatd.config.expected_bus import compare
from ecatd.config.slave_settings import SlaveConfig
from ecatd.config.startup import StartupConfig
from ecatd.config.writer import write_config
from ecatd.vendor.eni import Converted, convert, read_network
from ecatd.vendor.eni.report import Report
from ecatd.vendor.esi import Findings

OUTPUTS = (
    "<ProcessData><Sm2><Type>Outputs</Type><ControlByte>{}</ControlByte><Pdo>#x1600</Pdo></Sm2>"
    "</ProcessData>"
)


def converted(folder: Path, text: str) -> Converted:
    path = folder / "machine.xml"
    path.write_text(text)
    return convert(read_network(path), "ecat0")


def written(found: Converted) -> str:
    """The configuration as it is written, after checking that it reads as it was meant."""
    text = write_config(found.config, found.bus, "1.0", found.notes)
    config = read_config(tomllib.loads(text))
    assert not compare(config, found.bus.slaves).differences
    config = config.moved(compare(config, found.bus.slaves).places)
    assert write_config(config, found.bus, "1.0", found.notes) == text
    for one, other in zip(found.config.slave, config.slave, strict=True):
        assert (one.startup, one.pdo, one.alias, one.group, one.watchdog_ms) == (
            other.startup,
            other.pdo,
            other.alias,
            other.group,
            other.watchdog_ms,
        )
        assert one.pdos == other.pdos
    found.config.dc.enabled |= config.dc.enabled
    assert (found.config.domain, found.config.dc) == (config.domain, config.dc)
    return text


def one(folder: Path, **parts: str) -> tuple[SlaveConfig, Config, list[str]]:
    """The table of the only slave, the configuration, and what was not taken."""
    cyclic = parts.pop("cyclic", "")
    info = parts.pop("info", ids(2, 3))
    found = converted(folder, eni(slave("x", info, **parts), cyclic))
    written(found)
    return found.config.slave[0], found.config, [item.text for item in found.report.unsupported]


@pytest.mark.parametrize(
    "objects",
    [
        coe(0xF030, 0, "0300" + "08010000" + "00000000" + "02030000", ca=1),
        coe(0xF030, 0, "00") + coe(0xF030, 1, "08010000") + coe(0xF030, 3, "02030000")
        + coe(0xF030, 0, "03"),
    ],
)  # fmt: skip
def test_modules_of_an_island(tmp_path: Path, objects: str) -> None:
    settings, _, left = one(tmp_path, objects=objects + coe(0x8000, 1, "05"))
    assert [(item.slot, item.ident) for item in settings.module] == [(1, 0x108), (3, 0x302)]
    assert [item.object for item in settings.startup] == ["0x8000:01"]
    assert left == []


def test_a_report_has_no_heading_without_lines() -> None:
    report = Report()
    report.take(0, "name")
    heads = [line for line in report.lines("m.xml", {0: "slave 0"}) if not line.startswith(" ")]
    assert len(heads) == 2
    report.ours["the mailbox"] += 1
    heads = [line for line in report.lines("m.xml", {0: "slave 0"}) if not line.startswith(" ")]
    assert len(heads) == 3


def test_a_machine(tmp_path: Path) -> None:
    found = converted(tmp_path, MACHINE)
    text = written(found)
    config = found.config
    coupler, terminal, press, drive = config.slave
    assert [item.given_name for item in found.bus.slaves] == ["Term_1", "Term_2", "Press", "Term_3"]
    assert [item.name for item in found.bus.slaves] == ["EK1100", "EL2008", "CiA402", "ElmoGold"]
    assert (coupler.pdos, terminal.pdos) == (None, None), "they have no CoE"
    assert (terminal.watchdog_ms, press.watchdog_ms) == (50.0, None)
    assert press.pdos == [0x1600, 0x1A00]
    assert [(e.object, e.bits) for e in press.pdo[0].entries] == [
        ("0x6041:00", 16),
        ("0x6064:00", 32),
        (None, 16),
    ]
    assert drive.pdos == [0x1605, 0x1A02, 0x1A0A]
    assert press.startup == [
        StartupConfig("0x6060:00", "int8", "8", transition="IP", comment="mode CSP"),
        StartupConfig("0x6065:00", "uint32", "1234", transition="PS"),
        StartupConfig("0x6065:00", "uint32", "1234", transition="SO"),
    ]
    assert [(item.object, item.transition) for item in drive.startup] == [
        ("0x6081:00", "SO"),
        ("0x6081:00", "OS"),
    ]
    assert config.cycle_time_us == 2000
    assert [(d.name, d.divider, d.slaves) for d in config.domain] == [
        ("fast", 1, []),
        ("slow", 4, [1]),
    ]
    assert config.dc.enabled
    assert config.dc.reference == 0
    assert config.dc.slave == [DcSlaveConfig(2, 0.0, 250.0)]
    names(text, "0x6040:00 Controlword", "0x7000:01 Output", "machine.xml", "Press")
    left = [(item.slave, item.text) for item in found.report.unsupported]
    for slave_, what in (
        (3, "0x1018:01"),
        (3, "0x6082:00"),
        (3, "0x0F10"),
        (3, "<Modules>"),
    ):
        assert [n for n, text in left if what in text] == [slave_], what
    assert len(left) == 4
    assert found.report.ours["FMMUs and logical addresses"] == 4
    assert found.report.ours["entries of PDOs that are not assigned"] == 1
    assert found.report.ours["commands for all slaves at once"] == 2


def test_names_that_two_slaves_have_are_told(tmp_path: Path) -> None:
    found = converted(tmp_path, MACHINE.replace("Term 3 (", "Press ("))
    assert [item.given_name for item in found.bus.slaves][2:] == ["Press", "Press_2"]
    told = {n: any("'Press'" in part for part in parts) for n, parts in found.report.taken.items()}
    assert told == {0: False, 1: False, 2: False, 3: True}


def test_what_the_slaves_of_the_file_have_as_a_whole(tmp_path: Path) -> None:
    """Every command of the file is taken, ours, or named."""
    found = converted(tmp_path, MACHINE)
    commands = MACHINE.count("<Ado>") + MACHINE.count("<InitCmd/>")
    ours = (
        sum(found.report.ours.values()) - found.report.ours["entries of PDOs that are not assigned"]
    )
    registers = sum("register" in item.text for item in found.report.unsupported)
    assert ours + registers == commands


def test_hot_connect_groups_are_options_with_an_alias(tmp_path: Path) -> None:
    check = (
        "<Cmd>1</Cmd><Adp>0</Adp><Ado>{}</Ado><Data>0000</Data><Validate><Data>{}</Data></Validate>"
    )
    group = (
        "<HotConnect><GroupName>tool</GroupName><GroupMemberCnt>2</GroupMemberCnt><IdentifyCmd>{}"
    )
    group += "</IdentifyCmd></HotConnect>"
    clock = "<DC><ReferenceClock>1</ReferenceClock></DC>"
    named = '<Identification Value="{}"><Ado>{}</Ado></Identification>'
    found = converted(
        tmp_path,
        eni(
            slave("first", ids(2, 3), more=group.format(check.format(18, "0510")) + clock),
            slave("second", ids(2, 4)),
            slave("third", named.format(7, 18) + ids(2, 5)),
            slave("fourth", named.format(7, 18) + ids(2, 6)),
            slave("fifth", named.format(8, 0) + ids(2, 6)),
            slave("sixth", ids(2, 7), more="<HotConnect><GroupName>tool</GroupName></HotConnect>"),
        ),
    )
    text = written(found)
    rows = [(item.alias, item.group, item.optional) for item in found.config.slave]
    # A group that an alias finds has its place behind all other slaves.
    assert rows == [
        (7, "", False),
        (None, "", False),
        (None, "", False),
        (None, "tool_2", True),
        (0x1005, "tool", True),
        (None, "tool", True),
    ]
    assert text.count("position = ") == 3
    assert (found.config.dc.reference, found.config.dc.enabled) == (-1, True)
    same, other, clock = found.report.unsupported
    assert (same.slave, other.slave, clock.slave) == (1, 2, 4)
    names(clock.text, "reference clock")
    names(same.text, "alias", 7)
    names(other.text, "0x0000")


def test_identifications_find_slaves(tmp_path: Path) -> None:
    """By register 0x0134 on request, else at an address; also a hot connect group."""
    named = '<Identification Value="{}"><Ado>{}</Ado></Identification>'
    group = (
        "<HotConnect><GroupName>tool</GroupName><GroupMemberCnt>1</GroupMemberCnt><IdentifyCmd>"
        "<Cmd>1</Cmd><Adp>0</Adp><Ado>308</Ado><Data>0000</Data>"
        "<Validate><Data>2A00</Data></Validate></IdentifyCmd></HotConnect>"
    )
    found = converted(
        tmp_path,
        eni(
            slave("tool", ids(2, 3), more=group),
            slave("first", named.format(8, 0x134) + ids(2, 4)),
            slave("second", named.format(9, 0x1000) + ids(2, 5)),
            slave("third", named.format(8, 0x134) + ids(2, 6)),
            slave("fourth", named.format(8, 0x12) + ids(2, 7)),
        ),
    )
    text = written(found)
    rows = [
        (item.identification, item.identification_register, item.alias, item.group)
        for item in found.config.slave
    ]
    assert rows == [
        (8, None, None, ""),
        (9, 0x1000, None, ""),
        (None, None, None, ""),
        (None, None, 8, ""),
        (42, None, None, "tool"),
    ]
    assert text.count("position = ") == 1
    names(text, "identification_register = 0x1000", "identification = 42")
    (same,) = found.report.unsupported
    assert same.slave == 2
    names(same.text, "identification", 8)


def test_assignments_that_the_file_says_only_in_part(tmp_path: Path) -> None:
    assignment = coe(0x1C13, 1, "021a") + coe(0x1C13, 0, "01")
    settings, _, left = one(tmp_path, objects=assignment)
    assert settings.pdos is None, "pdos of one direction would take those of the other away"
    names(left, "0x1A02", "outputs")
    none = "<ProcessData><Recv><BitLength>8</BitLength></Recv></ProcessData>"
    settings, _, left = one(tmp_path, objects=assignment, data=none)
    assert (settings.pdos, left) == ([0x1A02], [])
    listed = OUTPUTS.format("#x64")
    settings, _, left = one(tmp_path, objects=assignment, data=listed)
    assert (settings.pdos, left) == ([0x1600, 0x1A02], [])
    empty = "<ProcessData/>"
    for wrong, what, data in (
        (coe(0x1C12, 0, "02") + coe(0x1C12, 1, "0016"), "0x1C12", empty),
        (coe(0x1C12, 0, "01") + coe(0x1C12, 1, "001600"), "0x1C12:01", empty),
        (coe(0x1C12, 0, "0100ff18", ca=1), "0x18FF", empty),
        (coe(0x1C12, 0, "020000160016", ca=1), "twice", empty),
        (coe(0x1600, 1, "00004060") + coe(0x1600, 0, "01"), "0x1600", ""),
    ):
        settings, _, left = one(tmp_path, objects=wrong, data=data)
        assert settings.pdo == []
        assert what in " ".join(left), left


@pytest.mark.parametrize(
    ("registers", "watchdogs", "problem"),
    [
        (command(0x0420, "e803", "IP"), (100.0, None), ""),
        (command(0x0420, "0000", "IP"), (0.0, None), ""),
        (command(0x0400, "e803", "IP") + command(0x0410, "e803", "IP"), (None, 40.1), ""),
        (command(0x0420, "e803", "SI"), (None, None), ""),
        (command(0x0400, "ffff", "IP") + command(0x0420, "ffff", "IP"), (None, None), "6553.5"),
    ],
)
def test_watchdogs(
    tmp_path: Path,
    registers: str,
    watchdogs: tuple[float | None, float | None],
    problem: str,
) -> None:
    settings, _, left = one(tmp_path, registers=registers, data=OUTPUTS.format("#x64"))
    assert (settings.watchdog_ms, settings.pdi_watchdog_ms) == watchdogs
    assert bool(left) == bool(problem)
    names(left, *filter(None, [problem]))
    off, _, _ = one(tmp_path, registers=registers, data=OUTPUTS.format("#x24"))
    assert off.watchdog_ms == 0, "the sync manager does not feed the watchdog"


@pytest.mark.parametrize(
    ("times", "base", "dividers", "problem"),
    [
        ((None, None), 1000, [], ""),
        ((500, 500), 500, [], ""),
        ((2000, 3000), 1000, [2, 3], ""),
        ((4000, 1000), 1000, [1, 4], ""),
        ((50, 50), 100, [], "50 µs"),
        ((1000, 1001), 1000, [], "1001 µs"),
        ((1000, 2_000_000), 1000, [], "2000000 µs"),
    ],
)
def test_cycles(
    tmp_path: Path,
    times: tuple[int | None, int | None],
    base: int,
    dividers: list[int],
    problem: str,
) -> None:
    found = converted(
        tmp_path,
        eni(
            slave("a", ids(2, 3), registers=fmmu(0, 0, 4, outputs=True)),
            slave("b", ids(2, 4), registers=fmmu(0, 4, 4, outputs=False)),
            task(times[0], 0, 4),
            task(times[1], 4, 4),
            task(777, 100, 1) if times[0] else "",  # exchanges nothing
        ),
    )
    text = written(found)
    assert found.config.cycle_time_us == base
    assert [domain.divider for domain in found.config.domain] == dividers
    if problem:
        names([item.text for item in found.report.unsupported], problem)
    assert ("no cycle time" in text) == (times[0] is None)


@pytest.mark.parametrize(
    ("activation", "cycles", "start", "expected", "problem"),
    [
        (0x0300, (1_000_000, 0), 0, DcSlaveConfig(0), ""),
        (0x0730, (500_000, 40_000), -100_000, DcSlaveConfig(0, 500.0, -100.0, 40.0), ""),
        (0x0300, (2_000_000, 5), 1_000, DcSlaveConfig(0, 2000.0, 1.0), ""),
        (0x0300, (300_000, 0), 0, None, "300 µs"),
        (0x0300, (0, 0), 0, None, "SYNC0"),
        (0x0700, (1_000_000, 4_294_967_295), 0, None, "4000000 µs"),
        (0x0100, (1_000_000, 0), 0, None, ""),
    ],
)
def test_sync_signals(
    tmp_path: Path,
    activation: int,
    cycles: tuple[int, int],
    start: int,
    expected: DcSlaveConfig | None,
    problem: str,
) -> None:
    periods = b"".join(cycle.to_bytes(4, "little") for cycle in cycles).hex()
    registers = (
        command(0x09A0, periods)
        + command(0x0990, start.to_bytes(8, "little", signed=True).hex())
        + command(0x0980, activation.to_bytes(2, "little").hex())
    )
    _, config, left = one(tmp_path, registers=registers, cyclic=task(1000, 0, 1))
    assert config.dc.slave == ([expected] if expected else [])
    assert bool(left) == bool(problem)
    names(left, *filter(None, [problem]))


def test_a_cycle_that_only_sync0_has(tmp_path: Path) -> None:
    clock = "<DC><ReferenceClock>true</ReferenceClock><CycleTime0>4000000</CycleTime0></DC>"
    _, config, left = one(tmp_path, registers=command(0x0980, "0003"), more=clock)
    assert (config.cycle_time_us, config.dc.slave, left) == (4000, [DcSlaveConfig(0)], [])
    _, config, left = one(tmp_path, more=clock)
    assert (config.cycle_time_us, config.dc.slave, config.dc.enabled) == (1000, [], True)
    names(left, "<CycleTime0>", "0x0980")


def test_a_parameter_before_the_pdos_is_pointed_out(tmp_path: Path) -> None:
    objects = coe(0x8000, 1, "01") + coe(0x1C12, 0, "00") + coe(0x1C13, 0, "00")
    found = converted(tmp_path, eni(slave("x", ids(2, 3), objects=objects)))
    names(written(found), "0x8000:01", "before the PDOs")
    assert found.config.slave[0].pdos == []


def test_large_numbers_may_be_negative(tmp_path: Path) -> None:
    found = converted(tmp_path, eni(slave("x", ids(2, 3, -127000646))))
    assert found.bus.slaves[0].revision == 2**32 - 127000646


@pytest.mark.parametrize(
    ("text", "tokens"),
    [
        ("<Network/>", ["<EtherCATConfig>", "<Network>"]),
        ("<EtherCATConfig/>", ["<Config>"]),
        ("<EtherCATConfig><Config/></EtherCATConfig>", ["<Slave>"]),
        ("<!DOCTYPE x [<!ENTITY a 'b'>]><EtherCATConfig/>", ["<!DOCTYPE>"]),
        ("<EtherCATConfig>", ["not XML"]),
        (eni(slave("Axis", "<VendorId>2</VendorId>")), ["<ProductCode>", "'Axis'"]),
        (eni(slave("Axis", "<VendorId>x</VendorId>")), ["<VendorId>", "'x'", "'Axis'"]),
    ],
)
def test_files_that_are_refused(tmp_path: Path, text: str, tokens: list[object]) -> None:
    with pytest.raises(ConfigError, match=naming(*tokens)) as error:
        converted(tmp_path, text)
    assert str(error.value).startswith(f"{tmp_path / 'machine.xml'}:")


@pytest.mark.parametrize(
    ("text", "tokens"),
    [
        (
            eni(slave("Axis", ids(2, 3), objects=coe(1, 0, "0"))),
            ["<Data>", "'Axis'", "hexadecimal", "this command is left out"],
        ),
        (eni(slave("x", ids(2, 3))).replace("Press", "Gr&ouml;&szlig;e"), ["&ouml;", "HTML"]),
        (eni(slave("Axis", ids(2, 3), objects=coe(1, 0, "00", ccs=7))), ["<Ccs>", 7, "'Axis'"]),
        (eni(slave("x", ids(2, 3), registers="<InitCmd/>")), ["<Cmd>", "'x'"]),
        (eni(slave("x", ids(2, 3)), "<Cyclic><CycleTime>a</CycleTime></Cyclic>"), ["<CycleTime>"]),
    ],
)
def test_what_is_wrong_is_reported_and_left_out(
    tmp_path: Path, text: str, tokens: list[object]
) -> None:
    found = converted(tmp_path, text)
    (left,) = found.report.unsupported
    names(left.text, *tokens)
    names(written(found), *tokens)
    with pytest.raises(ConfigError, match=naming(*tokens[:2])):
        read_network(tmp_path / "machine.xml", Findings(strict=True))


words = st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]), max_size=40).map(
    lambda text: text.replace("]]>", "").replace("\ufffe", "").replace("\uffff", "")
)
hexadecimal = st.binary(max_size=12).map(bytes.hex)
indices = st.sampled_from([0x1C12, 0x1C13, 0x1C14, 0x1600, 0x1601, 0x1A00, 0x6060, 0x8000, 0xFFFF])
transitions = st.sampled_from(["IP", "PS", "SO", "OS", "SP", "PP", ""])
objects = st.builds(
    coe,
    indices,
    st.sampled_from([0, 1, 2, 254, 255]),
    hexadecimal | st.sampled_from(["00", "01", "02", "0016", "001a", "10004060", "01000016"]),
    transitions,
    ca=st.integers(0, 1),
    ccs=st.integers(1, 2),
    more=words.map(lambda text: f"<Comment><![CDATA[{text}]]></Comment>"),
)
registers = st.builds(
    command,
    st.sampled_from([0x0120, 0x0400, 0x0410, 0x0420, 0x0600, 0x0980, 0x0990, 0x09A0, 0x0F00]),
    hexadecimal | st.sampled_from(["0003", "0007", "40420f0000000000", "e803"]),
    transitions,
    cmd=st.sampled_from([0, 1, 2, 5]),
) | st.builds(fmmu, st.integers(0, 2), st.integers(0, 8), st.integers(0, 3), outputs=st.booleans())
slaves = st.builds(
    slave,
    words,
    st.builds(
        ids,
        st.integers(0, 3),
        st.integers(0, 3),
        st.integers(-5, 5),
        st.none() | st.sampled_from([0, 65535, 65534]),
    ),
    objects=st.none() | st.lists(objects, max_size=8).map("".join),
    registers=st.lists(registers, max_size=6).map("".join),
    data=st.sampled_from(
        [
            "",
            "<ProcessData/>",
            "<ProcessData><Sm2><Type>Outputs</Type><Pdo>#x1600</Pdo></Sm2></ProcessData>",
        ]
    ),
    more=st.sampled_from(
        [
            "",
            "<DC><ReferenceClock>1</ReferenceClock><CycleTime0>500000</CycleTime0></DC>",
            "<HotConnect><GroupMemberCnt>2</GroupMemberCnt></HotConnect>",
        ]
    ),
)
tasks = st.builds(
    task,
    st.none() | st.sampled_from([0, 1, 99, 500, 1000, 1500, 2**31]),
    st.integers(0, 8),
    st.integers(0, 4),
    words.map(lambda text: f"<![CDATA[{text}]]>"),
)


@given(st.lists(slaves, min_size=1, max_size=4), st.lists(tasks, max_size=3))
def test_any_file_becomes_a_configuration_that_can_be_read(
    tmp_path_factory: pytest.TempPathFactory, parts: list[str], cyclic: list[str]
) -> None:
    written(converted(tmp_path_factory.getbasetemp(), eni(*parts, *cyclic)))
