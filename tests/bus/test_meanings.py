"""What values mean is said to the daemon, and everybody on the bus sees the same."""

from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon, names, one_line_error, run_module, wait_for
from ecatd.client.remote import Remote
from ecatd.etg.pdo import Entry

pytestmark = pytest.mark.bus
RIGS = Path(__file__).parents[1] / "rigs"

PROFILE = """
[[device]]
description = "EL3008 for {what}"
vendor = 2
product = [{product}]

[[device.entry]]
index = 0x6000
subindex = 0x11
step = 0x10
count = 8
unit = "{unit}"
scale = 0.5
"""
EL3008 = "0x0BC03052"


def write_profile(folder: Path, unit: str, product: str = EL3008, what: str = "tests") -> None:
    folder.mkdir(parents=True, exist_ok=True)
    text = PROFILE.format(unit=unit, product=product, what=what)
    (folder / f"{what}.toml").write_text(text)


def start(start_daemon: Callable[..., Daemon], config: str) -> Daemon:
    return start_daemon("troll", config=f"{config}\n[gateway]\nlisten = []\n")


def remote(daemon: Daemon, monkeypatch: pytest.MonkeyPatch) -> Remote:
    monkeypatch.setenv("ECATD_RUNTIME_DIR", daemon.env["ECATD_RUNTIME_DIR"])
    return Remote(daemon.bus)


def channel(daemon: Daemon, monkeypatch: pytest.MonkeyPatch, number: int) -> Entry:
    """The entry of a channel of the EL3008 at position 4."""
    with remote(daemon, monkeypatch) as session:
        slave = session.describe().slaves[4]
    entries = [entry for _, entry, _ in slave.entries(outputs=False) if entry.subindex == 0x11]
    return entries[number - 1]


def test_everybody_sees_volts(
    start_daemon: Callable[..., Daemon], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    daemon = start(start_daemon, "")
    entry = channel(daemon, monkeypatch, 8)
    assert (entry.unit, entry.scale, entry.offset) == ("V", 10 / 32767, 0.0)
    assert "[V = raw * 0.000305185]" in daemon.ctl("pdos", "4").stdout
    with daemon.client() as client:
        client.wait()
        client.sample()
        signal = client.signal("5/0x6070:11")  # a constant of 10 V, see the rig
        assert (signal.unit, signal.scale) == ("V", 10 / 32767)
        assert signal.value == pytest.approx(10.0, abs=0.01)
    daemon.ctl("generate", "Plant", str(tmp_path / "out"))
    block = (tmp_path / "out" / "Plant" / "EL3008.mo").read_text()
    assert 'unit = "V"' in block
    assert repr(10 / 32767) in block


def test_the_configuration_counts_before_the_profile_and_reaches_everybody(
    start_daemon: Callable[..., Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    daemon = start(
        start_daemon,
        '[[signal]]\nslave = 5\nentry = "0x6070:11"\nname = "tank"\nunit = "bar"\n'
        "scale = 0.25\noffset = -1.0\nvalues = { 32767 = 'full' }\n",
    )
    with daemon.client() as client:
        client.wait()
        client.sample()
        signal = client.signal("5/tank")
        assert signal.unit == "bar"
        assert signal.value == pytest.approx(signal.raw * 0.25 - 1.0)
        assert client.signal("5/0x6060:11").unit == "V"
    assert "tank  [bar = raw * 0.25 - 1]" in daemon.ctl("pdos", "5").stdout
    with remote(daemon, monkeypatch) as session:
        slave = session.describe().slaves[5]
    (tank,) = [entry for _, entry, _ in slave.entries(outputs=False) if entry.name == "tank"]
    assert [(value.number, value.name) for value in tank.values] == [(32767, "full")]


def test_folders_count_in_their_order(
    start_daemon: Callable[..., Daemon], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Those that the configuration names, the user's, ours."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    write_profile(tmp_path / "config" / "ecatd" / "profiles", "K")
    daemon = start(start_daemon, "")
    assert channel(daemon, monkeypatch, 1).unit == "K"
    daemon.stop()
    for name, unit in (("first", "A"), ("second", "m")):
        write_profile(tmp_path / name, unit)
    write_profile(tmp_path / "second", "s", product="0x12345678", what="spares")
    config = f'profiles = ["{tmp_path / "first"}", "{tmp_path / "second"}"]'
    daemon = start(start_daemon, config)
    assert channel(daemon, monkeypatch, 1).unit == "A"
    wait_for(lambda: "'EL3008 for spares'" in daemon.log, daemon)
    (told,) = (line for line in daemon.log.splitlines() if "'EL3008 for spares'" in line)
    names(told, f"'{daemon.bus}'", "product 0x12345678")
    assert "'EL3008 for tests'" not in daemon.log


@pytest.mark.parametrize(
    ("profile", "message"),
    [
        ("[[device]]\nvendor = 1\n", "mine/tests.toml:1: device[0].description: | missing"),
        (None, "mine' | folder"),
    ],
)
def test_a_wrong_profile_ends_the_start_before_anything_is_sent(
    tmp_path: Path, profile: str | None, message: str
) -> None:
    config = tmp_path / "ecat0.toml"
    config.write_text('profiles = ["mine"]\n')
    if profile is not None:
        (tmp_path / "mine").mkdir()
        (tmp_path / "mine" / "tests.toml").write_text(profile)
    for options in (("--check-config",), ("--simulate", "troll", "--bus", "wrongprofile")):
        done = run_module("ecatd.service", "--config", str(config), *options)
        assert done.returncode == 2
        names(one_line_error(done.stderr, "ecatd"), *message.split(" | "))
        assert "slaves found" not in done.stderr


def test_a_type_that_no_slave_tells_is_told_and_can_be_configured(
    start_daemon: Callable[..., Daemon],
) -> None:
    config = '[[signal]]\nslave = 1\nentry = "0x1A00:01"\ntype = "int16"\n[gateway]\nlisten = []\n'
    daemon = start_daemon(str(RIGS / "typeless.py"), config=config)
    (told,) = [line for line in daemon.log.splitlines() if "type" in line]
    names(told, "slave 0 (Typeless)", "0x1A00:01", "unsigned", "[[signal]]", "--esi")
    with daemon.client() as client:
        both = [client.signal(slave, 0x1A00, 1) for slave in (0, 1)]

        def are_there() -> bool:
            client.wait()
            client.sample()
            return [signal.raw for signal in both] == [0xFFFE, -2]

        wait_for(are_there, daemon)
