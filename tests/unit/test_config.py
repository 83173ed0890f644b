"""The configuration file: what is taken, and what is said about what is not."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from conftest import names, naming, without_notes
from ecatd.base.errors import ConfigError
from ecatd.config import (
    Config,
    CopyConfig,
    DcConfig,
    DcSlaveConfig,
    DomainConfig,
    ExpectedConfig,
    ModuleConfig,
    PdoConfig,
    PdoEntryConfig,
    SafeConfig,
    SignalConfig,
    SlaveConfig,
    StartupConfig,
    load_config,
    read_config,
)
from ecatd.config.writer import write_config
from ecatd.description.bus import Bus, Slave
from ecatd.description.limits import POSITION_MAX

COPY = "[[copy]]\nslave = 1\nentry = '0x7000:01'\nfrom_slave = 0\nfrom_entry = '0x6000:01'\n"


def load(tmp_path: Path, text: str) -> Config:
    file = tmp_path / "ecat0.toml"
    file.write_text(text)
    return load_config(file)


def test_empty_file_gives_the_defaults(tmp_path: Path) -> None:
    assert load(tmp_path, "") == Config()


def test_every_key_is_taken(tmp_path: Path) -> None:
    config = load(
        tmp_path,
        """
        bus = "rig"
        interface = "eth1"
        second_interface = "eth2"
        cycle_time_us = 250
        state_timeout_s = 3
        [log]
        level = "debug"
        mailbox = "error"
        [expected]
        policy = "tolerant"
        unlisted = false
        description = "full.json"
        [[slave]]
        position = 3
        name = "drive-2"
        type = "EL7211"
        vendor = 2
        product = 0x1C2B3052
        revision_min = 0x00100000
        serial = 12
        policy = "strict"
        group = "tool"
        watchdog_ms = 20.5
        pdi_watchdog_ms = 0
        mailbox_timeout_ms = 5000
        mailbox_tries = 2
        mailbox_poll_ms = 0
        pdo_source = "sii"
        pdos = ["0x1605", 0x1A02]
        [[slave.module]]
        slot = 2
        ident = 0x11
        type = "DI8"
        [[slave.pdo]]
        index = "0x1605"
        entries = [{ object = "0x6040:00", bits = 16 }, { bits = 8 }]
        [[slave.startup]]
        object = "0x6065:00"
        type = "uint32"
        value = 1234
        transition = "IP"
        optional = true
        comment = "window"
        [[slave.startup]]
        object = "0x1C32:00"
        hex = "01 00"
        complete = true
        [[slave.startup]]
        object = "0x6083:00"
        type = "uint32"
        value = 1.5
        unit = "rad/s2"
        [[slave]]
        identification = 42
        identification_register = 0x0F80
        [[domain]]
        name = "fast"
        [[domain]]
        name = "slow"
        divider = 4
        phase = 3
        slaves = [3, "5-7", "9"]
        [dc]
        reference = 2
        phase_us = 100
        lock_us = 5
        timeout_s = 10
        [[dc.slave]]
        slave = 0
        sync0_us = 125
        shift_us = -30
        sync1_us = 62.5
        [[dc.slave]]
        slave = 6
        [mailbox]
        share = 0.25
        [realtime]
        priority = 50
        cpu = 1
        lock_memory = false
        busy_receive = true
        dma_latency_us = -1
        [outputs]
        lease_cycles = 7
        lease_max_ms = 100
        wkc_limit = 3
        [[outputs.safe]]
        slave = 3
        value = "hold"
        [[outputs.safe]]
        slave = 0
        entry = "0x60FF:00"
        value = -5
        [[outputs.safe]]
        slave = 1
        value = "quick_stop"
        stop_timeout_s = 3
        [[outputs.safe]]
        slave = 2
        entry = "0x7000:01"
        value = 1.5
        [[signal]]
        slave = 0
        entry = "0x60FF:00"
        name = "speed"
        unit = "rpm"
        scale = 0.5
        offset = 1
        minimum = -100
        maximum = 100
        [[signal]]
        slave = 0
        entry = "0x606c:0"
        [[copy]]
        slave = 1
        entry = "0x7000:01"
        from_slave = "drive-2"
        from_entry = "0x6000:1"
        factor = -2
        offset = 0.5
        [[copy]]
        slave = 1
        entry = "0x7000:02"
        from_slave = 0
        from_entry = "0x6000:01"
        [gateway]
        listen = ["tcp/127.0.0.1:7000"]
        publish_hz = 2.5
        metrics = "127.0.0.1:9754"
        """,
    )
    assert (config.bus, config.interface, config.cycle_time_us) == ("rig", "eth1", 250)
    assert config.second_interface == "eth2"
    assert config.slave == [
        SlaveConfig(
            3,
            "drive-2",
            "EL7211",
            2,
            0x1C2B3052,
            None,
            0x00100000,
            12,
            None,
            None,
            None,
            "strict",
            True,
            "tool",
            20.5,
            0.0,
            5000,
            2,
            0,
            [ModuleConfig(2, 0x11, "DI8")],
            [0x1605, 0x1A02],
            [PdoConfig(0x1605, [PdoEntryConfig(16, "0x6040:00"), PdoEntryConfig(8)])],
            "sii",
            [
                StartupConfig(
                    "0x6065:00", "uint32", "1234", None, None, False, "IP", True, "window"
                ),
                StartupConfig("0x1C32:00", hex="01 00", complete=True),
                StartupConfig("0x6083:00", "uint32", "1.5", "rad/s2"),
            ],
        ),
        SlaveConfig(POSITION_MAX + 2, identification=42, identification_register=0x0F80),
    ]
    assert config.expected == ExpectedConfig("tolerant", False, str(tmp_path / "full.json"))
    assert [item.data for item in config.slave[0].startup[:2]] == [b"\xd2\x04\0\0", b"\1\0"]
    assert config.domain == [DomainConfig("fast"), DomainConfig("slow", 4, 3, [3, 5, 6, 7, 9])]
    assert config.dc == DcConfig(
        True,  # since there is a table for a slave
        reference=2,
        phase_us=100.0,
        lock_us=5.0,
        timeout_s=10.0,
        slave=[DcSlaveConfig(0, 125.0, -30.0, 62.5), DcSlaveConfig(6)],
    )
    assert config.mailbox.share == 0.25
    assert config.realtime.dma_latency_us == -1
    assert config.state_timeout_s == 3.0
    assert (config.realtime.priority, config.realtime.cpu) == (50, 1)
    assert config.realtime.busy_receive
    assert not config.realtime.lock_memory
    assert (config.outputs.lease_cycles, config.outputs.lease_max_ms) == (7, 100)
    assert config.outputs.safe[0].value == "hold"
    assert config.outputs.safe[1].address == (0x60FF, 0)
    assert config.outputs.safe[2:] == [
        SafeConfig(1, "quick_stop", stop_timeout_s=3.0),
        SafeConfig(2, 1.5, "0x7000:01"),
    ]
    assert (config.outputs.wkc_limit, config.outputs.longest_stop) == (3, 3.0)
    assert config.signal == [
        SignalConfig(0, "0x60FF:00", "speed", "rpm", 0.5, 1.0, -100.0, 100.0),
        SignalConfig(0, "0x606C:00"),
    ]
    assert config.signal[1].address == (0x606C, 0)
    assert config.copy == [
        CopyConfig(1, "0x7000:01", 3, "0x6000:01", -2.0, 0.5),
        CopyConfig(1, "0x7000:02", 0, "0x6000:01"),
    ]
    assert (config.copy[0].address, config.copy[0].from_address) == ((0x7000, 1), (0x6000, 1))
    assert config.gateway.listen == ["tcp/127.0.0.1:7000"]
    assert config.gateway.publish_hz == 2.5
    assert read_config(json.loads(json.dumps(config.to_dict()))) == config


def test_slaves_follow_their_domain(tmp_path: Path) -> None:
    config = load(
        tmp_path,
        """
        cycle_time_us = 500
        [[domain]]
        [[domain]]
        divider = 3
        slaves = [1]
        [[dc.slave]]
        slave = 1
        [[dc.slave]]
        slave = 7
        sync0_us = 250
        shift_us = 0
        """,
    )
    assert [config.domain_of(position) for position in (0, 1, 2)] == [0, 1, 0]
    assert [config.domain_cycle_us(position) for position in (0, 1)] == [500, 1500]
    first, second = config.dc.slave
    assert (config.sync0_us(first), config.shift_us(first)) == (1500, 250)
    assert (config.sync0_us(second), config.shift_us(second)) == (250, 0)
    assert Config().domain_of(5) == 0
    assert Config().domain_cycle_us(5) == 1000


def test_clocks_can_be_switched_off_with_tables_in_place(tmp_path: Path) -> None:
    text = "[dc]\nenabled = {}\n[[dc.slave]]\nslave = 0\n"
    assert not load(tmp_path, text.format("false")).dc.enabled
    assert load(tmp_path, text.format("true")).dc.enabled
    assert not load(tmp_path, "[dc]\nenabled = false\nreference = 1").dc.enabled


SLAVE = "[[slave]]\nposition = 0\n"
PDO = "[[slave.pdo]]\nindex = 0x1600\nentries = []\n"
START = "[[slave.startup]]\nobject = '0x6065:00'\n"
RPM = "type = 'int16'\nunit = 'rpm'\n"
SCALED = (
    "[[signal]]\nslave = 0\nentry = '0x6065:00'\nunit = 'rpm'\nscale = 0.1\n"
    "minimum = -900\nmaximum = 900"
)
INT8 = "type = 'int8'\n"


@pytest.mark.parametrize(
    ("given", "written"),
    [
        ("type = 'uint16'\nvalue = '0x1F'", "value = 31"),
        ("type = 'int16'\nvalue = '-0b11'", "value = -3"),
        ("type = 'bool'\nvalue = '1'", "value = true"),
        ("type = 'float'\nvalue = '5e-1'", "value = 0.5"),
        ("type = 'float'\nvalue = 5", "value = 5.0"),
        ("type = 'string'\nvalue = '0x1F'", 'value = "0x1F"'),
        (f"{RPM}value = '12'", "value = 12.0"),
    ],
)
def test_numbers_are_written_as_numbers(tmp_path: Path, given: str, written: str) -> None:
    config = load(tmp_path, f"{SLAVE}{START}{given}\n{SCALED}")
    text = write_config(config, Bus("ecat0", 1000, [Slave(0, "", 1, 2, 3, 0)]), "1.0")
    assert f"\n{written}\n" in text
    (again,) = load(tmp_path, text).slave
    assert again.startup == config.slave[0].startup


@pytest.mark.parametrize(
    ("text", "where", "what"),
    [
        ("cycle_time = 1000", ":1: cycle_time:", "'cycle_time_us'"),
        ("[gateway]\nmetrics = '0.0.0.0:80'", ":2: gateway.metrics:", "other machines | 127.0.0.1"),
        ("[gateway]\nmetrics = '127.a.example:80'", ":2: gateway.metrics:", "other machines"),
        ('[gateway]\nmetrics = "unix:/a\\u0000b"', ":2: gateway.metrics:", "not the path"),
        (
            "[gateway]\nlisten = ['unixsock-stream//x/']",
            ":2: gateway.listen[0]:",
            "/x/ | path",
        ),
        (f"[gateway]\nmetrics = 'unix:/{'ü' * 60}'", ":2: gateway.metrics:", "too long | 107"),
        (
            "[gateway]\nmetrics = '127.0.0.1'",
            ":2: gateway.metrics:",
            "address | 127.0.0.1:9754",
        ),
        ("[dc]\ncycle_time_us = 500", ":2: dc.cycle_time_us:", "[table]"),
        ("[[slave]]", ":1: slave[0].position:", "missing"),
        (f"{SLAVE}{SLAVE}", ":4: slave[1].position:", "slave 0"),
        (f"{SLAVE}pdos = ['0x1505']", ":3: slave[0].pdos[0]:", "'0x1505' | 0x1600 | 0x1BFF"),
        (f"{SLAVE}pdos = [0x1600, '0x1600']", ":3: slave[0].pdos[1]:", "0x1600"),
        (f"{SLAVE}pdos = [0x1601]\n{PDO}", ":5: slave[0].pdo[0].index:", "0x1600 | pdos"),
        (f"{SLAVE}{PDO}{PDO}", ":7: slave[0].pdo[1].index:", "0x1600"),
        (f"{SLAVE}[[slave.pdo]]\nindex = 0x1600", ":3: slave[0].pdo[0].entries:", "entries = []"),
        ("[[slave]]\nalias = 1\nidentification = 2", ":3: slave[0].identification:", "alias"),
        ("[[slave]]\nposition = 1\nidentification = 2", ":2: slave[0].position:", "identification"),
        (f"{SLAVE}identification_register = 0x130", ":1: slave[0].identification:", "missing"),
        ("[[slave]]\nidentification = 2\n" * 2, ":4: slave[1].identification:", "identification 2"),
        (f"{SLAVE}{START}value = 1", ":3: slave[0].startup[0].type:", "missing | hex"),
        (f"{SLAVE}{START}hex = '0g'", ":5: slave[0].startup[0].hex:", "'0g'"),
        (f"{SLAVE}{START}hex = ''", ":5: slave[0].startup[0].hex:", "0 | 1 | 32768"),
        (f"{SLAVE}{START}{INT8}value = 128", ":6: slave[0].startup[0].value:", "128 | -128 | 127"),
        (f"{SLAVE}{START}{INT8}value = 1.5", ":6: slave[0].startup[0].value:", "1.5 | int8"),
        (f"{SLAVE}{START}type = 'lreal'\nvalue = 1{'0' * 400}", ":6: slave", "finite"),
        (f"{SLAVE}{START}{RPM}value = 'nan'", ":7: slave[0].startup[0].value:", "finite | nan"),
        (f"{SLAVE}{START}{RPM}value = 'x'", ":7: slave[0].startup[0].value:", "number | unit"),
        (f"{SLAVE}{START}{RPM}value = true", ":7: slave[0].startup[0].value:", "number | true"),
        (
            f"{SLAVE}{START}{RPM}value = 1e9\n{SCALED}",
            ":7: slave[0].startup[0].value:",
            "1000000000 rpm | INTEGER16",
        ),
        (
            f"{SLAVE}{START}{RPM}value = 901\n{SCALED}",
            ":7: slave[0].startup[0].value:",
            "901 rpm | 0x6065:00 | -900 to 900 rpm",
        ),
        (
            f"{SLAVE}{START}{RPM}value = 1\n{SCALED.replace('rpm', 'V')}",
            ":7: slave[0].startup[0].value:",
            "in V | not in rpm",
        ),
        (
            f"{SLAVE}{START}type = 'string'\nvalue = 1\nunit = 'V'",
            ":7: slave[0].startup[0].unit:",
            "numbers | string",
        ),
        (f"{SLAVE}{START}hex = '00'\nunit = 'V'", ":5: slave[0].startup[0].hex:", "unit"),
        (f"{SLAVE}{START}{INT8}value = []", ":6: slave[0].startup[0].value:", "array"),
        (f"{SLAVE}{START}type = 'tiny'", ":5: slave[0].startup[0].type:", "'tiny' | uint8"),
        (
            f"{SLAVE}{START}{INT8}value = 1\ncomplete = true",
            ":7: slave[0].startup[0].complete:",
            "hex",
        ),
        (
            f"{SLAVE}{START}hex = '00'\ntransition = 'XY'",
            ":6: slave[0].startup[0].transition:",
            '"IP" | "PS" | "SO"',
        ),
        ("interface = 7", ":1: interface:", "text | 7"),
        ("bus = '-a'", ":1: bus:", "bus name | '-a'"),
        ("interface = 'aaaaaaaaaaaaaaaa'", ":1: interface:", "15"),
        ("[[dc]]\nenabled = true", ":1: dc:", "[dc] | array"),
        ("cycle_time_us = {}", ":1: cycle_time_us:", "whole number | table"),
        ("[[domain]]\nslaves = [true]", ":2: domain[0].slaves[0]:", "true | position"),
        ("[gateway]\nlisten = ['nonsense']", ":2: gateway.listen[0]:", "Zenoh"),
        ("[gateway]\nlisten = ['udp/a:x#b=c']", ":2: gateway.listen[0]:", "'x' | 1 | 65535"),
        (
            "[gateway]\nlisten = ['tcp/a:1', 'tcp/b:1', 'tcp/a:1']",
            ":2: gateway.listen[2]:",
            "'tcp/a:1' | twice | remove",
        ),
        ("[[outputs.safe]]\nslave = 1\nvalue = 'keep'", ":3: outputs.safe[0].value:", "'keep'"),
        ("[[outputs.safe]]\nslave = 1\nvalue = 3", ":3: outputs.safe[0].value:", "number | entry"),
        (
            "[[outputs.safe]]\nslave = 1\nvalue = true",
            ":3: outputs.safe[0].value:",
            'number | "hold"',
        ),
        (
            "[[outputs.safe]]\nslave = 1\nvalue = inf",
            ":3: outputs.safe[0].value:",
            "finite",
        ),
        (
            "[[outputs.safe]]\nslave = 1\nvalue = 'hold'\nstop_timeout_s = 1",
            ":4: outputs.safe[0].stop_timeout_s:",
            '"quick_stop" | "disable"',
        ),
        ("signal = 3", ":1: signal:", "[[signal]]"),
        ("[[signal]]\nentry = '0x1:0'", ":1: signal[0].slave:", "missing"),
        ("[[signal]]\nslave = 1", ":1: signal[0].entry:", "missing"),
        ("[[signal]]\nslave = 1\nentry = '0x1:0'\nscale = 0", ":4: signal[0].scale:", "0"),
        (
            "[[signal]]\nslave = 1\nentry = '0x1:0'\nscale = nan",
            ":4: signal[0].scale:",
            "finite | nan",
        ),
        (
            "[[signal]]\nslave = 1\nentry = '0x1:0'\nminimum = 2\nmaximum = 1",
            ":4: signal[0].minimum:",
            "2 | 1 | maximum",
        ),
        (
            "[[signal]]\nslave = 1\nentry = '0x1:0'\n[[signal]]\nslave = 1\nentry = '0x0001:00'",
            ":6: signal[1].entry:",
            "0x0001:00 | slave 1",
        ),
        (
            "[[outputs.safe]]\nslave = 1\nentry = '60FF'",
            ":3: outputs.safe[0].entry:",
            "address | '60FF'",
        ),
        (COPY.replace("slave = 1\n", "slave = 'lamp'\n", 1), ":2: copy[0].slave:", "'lamp'"),
        (
            f"{COPY}{COPY.replace('0x7000:01', '7000:1')}",
            ":8: copy[1].entry:",
            "0x7000:01 of slave 1 | another input",
        ),
        (
            "interface = 'eth1'\nsecond_interface = 'eth1'",
            ":2: second_interface:",
            "'eth1' | interface",
        ),
        (
            "[domain]\nname = 'x'",
            ":1: domain:",
            "[[domain]]",
        ),
        ("[[domain]]\nphase = 1", ":2: domain[0].phase:", "divider | 1"),
        (
            "[[domain]]\nslaves = [1, '0-2']",
            ":2: domain[0].slaves[1]:",
            "slave 1 | domain 0",
        ),
        (
            "[[domain]]\nslaves = ['2-4']\n[[domain]]\nslaves = [7, 3]",
            ":4: domain[1].slaves[1]:",
            "slave 3 | domain 0",
        ),
        ("[[domain]]\n[[domain]]\nname = 'b'", ":2: domain[1].slaves:", "domain 1"),
        (
            "[[domain]]\nname = 'a'\n[[domain]]\nname = 'a'\nslaves = [1]",
            ":4: domain[1].name:",
            "'a' | domain",
        ),
        ('[[domain]]\nname = "a\\u0000"', ":2: domain[0].name:", "printable"),
        (
            "".join(f"[[domain]]\nslaves = [{n}]\n" for n in range(17)),
            ":33: domain[16]:",
            "16",
        ),
        (
            "[[slave]]\nposition = 0\n[[slave.startup]]\nobject = '0x2000:00'\ntype = 'string'\n"
            'value = """\n[dc]\nreference = 1"""\n[dc]\nreference = -2',
            ":10: dc.reference:",
            "-2 | -1 | 65535",
        ),
        (
            "[outputs]\nsafe = [\n{ slave = 1, value = 'hold' },\n{ slave = 2, valu = 3 } ]",
            ":4: outputs.safe[1].valu:",
            "'value'",
        ),
        ("dc.slave = [{ slave = 1 }, { slave = 1 }]", ":1: dc.slave[1].slave:", "slave 1"),
        (
            "[[signal]]\nslave = 1\nentry = '0x1:0'\nvalues = { x = 'a' }",
            ":4: signal[0].values.x:",
            "whole number",
        ),
        ("[dc]\nreference = 1", ":2: dc.reference:", "does nothing | clock"),
        (
            "[dc]\nenabled = true\nphase_us = 1000",
            ":3: dc.phase_us:",
            "1000 µs",
        ),
        ("[dc]\nenabled = true\nlock_us = 501", ":3: dc.lock_us:", "500 µs"),
        ("[dc]\nlock_us = 0", ":2: dc.lock_us:", "0 | 0.1"),
        (
            "[[domain]]\n[[domain]]\ndivider = 3\nslaves = [1]\n"
            "[[dc.slave]]\nslave = 1\nsync0_us = 2000",
            ":7: dc.slave[0].sync0_us:",
            "slave 1 | 3000 µs",
        ),
        (
            "cycle_time_us = 1000000\n[[domain]]\ndivider = 5\n[[dc.slave]]\nslave = 1",
            ":4: dc.slave[0].sync0_us:",
            "domain | 5000000 µs",
        ),
    ],
)
def test_wrong_keys_and_values(tmp_path: Path, text: str, where: str, what: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, text)
    assert str(tmp_path / "ecat0.toml") + where in without_notes(caught.value)
    names(caught.value, *what.split(" | "))


def test_a_pdo_without_an_index_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, "[[slave]]\nposition = 0\n[[slave.pdo]]\nentries = []\n")
    assert ":3: slave[0].pdo[0].index (slave 0): is missing" in str(caught.value)


@pytest.mark.parametrize(
    ("keys", "about"),
    [
        ("position = 2\nname = 'press'\n", "slave 2, press"),
        ("alias = 7\n", "alias 7"),
        ("identification = 5\nname = 'tool'\n", "identification 5, tool"),
    ],
)
def test_a_mistake_in_a_table_of_a_slave_names_the_slave(
    tmp_path: Path, keys: str, about: str
) -> None:
    """The number of the table is not its position."""
    lines = keys.count("\n")
    for wrong, key, line in (
        ("watchdog_ms = 7000\n", "watchdog_ms", 2),
        ("[[slave.startup]]\nobject = 'x'\n", "startup[0].object", 3),
    ):
        with pytest.raises(ConfigError) as caught:
            load(tmp_path, f"[[slave]]\nposition = 9\n[[slave]]\n{keys}{wrong}")
        where = f":{2 + lines + line}: slave[1].{key} ({about}): "
        assert where in str(caught.value)


@pytest.mark.parametrize("value", ["'inf\\n'", '"inf\\n"', '"1\\n2"'])
def test_a_value_of_several_lines_is_refused_in_one(tmp_path: Path, value: str) -> None:
    table = f"[[slave.startup]]\nobject = '0x1:0'\ntype = 'real32'\nvalue = {value}\n"
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, f"[[slave]]\nposition = 0\n{table}")
    assert "\n" not in str(caught.value)


def test_broken_toml_names_file_and_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=naming("ecat0.toml:2:", "TOML", "Invalid value")):
        load(tmp_path, "bus = 'x'\ninterface =\n")


@pytest.mark.parametrize(
    "text",
    [
        "state_timeout_s = 1" + 400 * "0",
        "[[dc.slave]]\nslave = 0\nshift_us = 1" + 400 * "0",
        "cycle_time_us = 1" + 5000 * "0",
        "cycle_time_us = 0x1" + 5000 * "0",
        "domain = " + 3000 * "[" + 3000 * "]",
    ],
    ids=["float", "shift", "digits", "hexadecimal", "brackets"],
)
def test_values_beyond_all_measure_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(ConfigError, match=naming("ecat0.toml")) as caught:
        load(tmp_path, text)
    assert "\n" not in str(caught.value)


def test_a_byte_order_mark_does_no_harm(tmp_path: Path) -> None:
    file = tmp_path / "ecat0.toml"
    file.write_text("cycle_time_us = 2000\n", "utf-8-sig")
    assert load_config(file).cycle_time_us == 2000
    file.write_text("cycle_time_us = 0\n", "utf-8-sig")
    with pytest.raises(ConfigError, match=naming(f"{file}:1", "cycle_time_us")):
        load_config(file)


def test_missing_and_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=naming(tmp_path / "none.toml", "No such file")):
        load_config(tmp_path / "none.toml")
    (tmp_path / "latin.toml").write_bytes(b"bus = '\xe4'")
    with pytest.raises(ConfigError, match=naming(tmp_path / "latin.toml", "UTF-8")):
        load_config(tmp_path / "latin.toml")


SCALARS = st.one_of(
    st.integers(-3, 1200),
    st.integers(),
    st.floats(),
    st.booleans(),
    st.text(max_size=5),
    st.sampled_from(
        ["5-7", "zero", "hold", "quick_stop", "0x60FF:00", "tcp/127.0.0.1:7447", "eth1"]
    ),
)


def table(*keys: str) -> st.SearchStrategy[dict[str, Any]]:
    """A table with some of these keys, with right values, wrong ones, and others."""
    values = st.one_of(SCALARS, st.lists(SCALARS, max_size=3), st.dictionaries(st.text(), SCALARS))
    return st.fixed_dictionaries({}, optional=dict.fromkeys(keys, values))


def rows(*keys: str) -> st.SearchStrategy[Any]:
    return st.one_of(st.lists(table(*keys), max_size=3), SCALARS)


CONFIGURATIONS = st.fixed_dictionaries(
    {},
    optional={
        **dict.fromkeys(("bus", "interface", "second_interface", "cycle_time_us"), SCALARS),
        "domain": rows("name", "divider", "phase", "slaves", "a\nb"),
        "dc": st.one_of(
            SCALARS,
            st.fixed_dictionaries(
                {},
                optional={
                    "phase_us": SCALARS,
                    "lock_us": SCALARS,
                    "enabled": SCALARS,
                    "slave": rows("slave", "sync0_us", "shift_us", "sync1_us"),
                },
            ),
        ),
        "mailbox": st.one_of(SCALARS, table("share")),
        "realtime": st.one_of(SCALARS, table("priority", "cpu", "dma_latency_us", "\n")),
        "outputs": st.one_of(
            SCALARS,
            st.fixed_dictionaries(
                {}, optional={"safe": rows("slave", "entry", "value", "stop_timeout_s")}
            ),
        ),
        "signal": rows("slave", "entry", "unit", "scale", "offset", "minimum", "maximum"),
        "gateway": st.one_of(SCALARS, table("listen", "publish_hz", "metrics")),
    },
)


@given(CONFIGURATIONS)
def test_anything_is_taken_or_refused_in_one_line(data: dict[str, Any]) -> None:
    said = ""
    try:
        config = read_config(data)
        assert read_config(json.loads(json.dumps(config.to_dict()))) == config
    except ConfigError as error:
        said = str(error)
    assert "\n" not in said


def test_the_gateway_may_listen_on_unix_sockets() -> None:
    written = {"listen": ["unixsock-stream//run/here"], "metrics": "unix:/run/there"}
    gateway = read_config({"gateway": written}).gateway
    assert {"listen": gateway.listen, "metrics": gateway.metrics} == written


@pytest.mark.parametrize(
    ("connect", "router_names"), [("tls/hub:7447", "[]"), ("tls/10.0.0.3:7447", "['hub']")]
)
def test_no_user_has_the_name_of_a_router(tmp_path: Path, connect: str, router_names: str) -> None:
    """A router passes on what users ask for, so its certificate may speak for each of them."""
    with pytest.raises(ConfigError, match=naming("'hub'", "name of a router")):
        load(
            tmp_path,
            "[gateway]\nhost = 'cell4'\ncertificate = '/c'\nkey = '/k'\nusers_ca = '/u'\n"
            f"connect = ['{connect}']\nrouter_names = {router_names}\n"
            "[[gateway.user]]\nname = 'hub'\n",
        )
