"""The configuration file: what is taken, and what is said about what is not."""

from pathlib import Path

import pytest

from ecatd.model.config import Config
from ecatd.model.errors import ConfigError


def load(tmp_path: Path, text: str) -> Config:
    file = tmp_path / "ecat0.toml"
    file.write_text(text)
    return Config.load(file)


def test_empty_file_gives_the_defaults(tmp_path: Path) -> None:
    assert load(tmp_path, "") == Config()


def test_every_key_is_taken(tmp_path: Path) -> None:
    config = load(
        tmp_path,
        """
        bus = "rig"
        interface = "eth1"
        cycle_time_us = 250
        state_timeout_s = 3
        [realtime]
        priority = 50
        cpu = 1
        lock_memory = false
        busy_receive = true
        [outputs]
        lease_cycles = 7
        lease_max_ms = 100
        [[outputs.safe]]
        slave = 3
        value = "hold"
        [[outputs.safe]]
        slave = 0
        entry = "0x60FF:00"
        value = -5
        [gateway]
        listen = ["tcp/127.0.0.1:7000"]
        publish_hz = 2.5
        """,
    )
    assert (config.bus, config.interface, config.cycle_time_us) == ("rig", "eth1", 250)
    assert config.state_timeout_s == 3.0
    assert (config.realtime.priority, config.realtime.cpu) == (50, 1)
    assert config.realtime.busy_receive
    assert not config.realtime.lock_memory
    assert (config.outputs.lease_cycles, config.outputs.lease_max_ms) == (7, 100)
    assert config.outputs.safe[0].value == "hold"
    assert config.outputs.safe[1].address == (0x60FF, 0)
    assert config.gateway.listen == ["tcp/127.0.0.1:7000"]
    assert config.gateway.publish_hz == 2.5
    assert Config.from_dict(config.to_dict()) == config


@pytest.mark.parametrize(
    ("text", "where", "what"),
    [
        ("cycle_time = 1000", ":1: cycle_time:", "did you mean 'cycle_time_us'?"),
        ("\n[realtime]\nprio = 1", ":3: realtime.prio:", "did you mean 'priority'?"),
        ("[gateway]\npublish = 1", ":2: gateway.publish:", "did you mean 'publish_hz'?"),
        ("zzz = 1", ":1: zzz:", "valid are bus, interface"),
        ("cycle_time_us = 10", ":1: cycle_time_us:", "must be from 100 to 1000000"),
        ("cycle_time_us = '1000'", ":1: cycle_time_us:", "must be a whole number"),
        ("cycle_time_us = true", ":1: cycle_time_us:", "must be a whole number"),
        ("interface = 7", ":1: interface:", "must be a text in quotes"),
        ("bus = 'a/b'", ":1: bus:", "is no bus name"),
        ("interface = 'aaaaaaaaaaaaaaaa'", ":1: interface:", "at most 15 characters"),
        ("realtime = 1", ":1: realtime:", "must be a table"),
        ("[gateway]\nlisten = ['nonsense']", ":2: gateway.listen:", "is no Zenoh endpoint"),
        ("[[outputs.safe]]\nvalue = 'hold'", ": outputs.safe.slave:", "is missing"),
        ("[[outputs.safe]]\nslave = 1\nvalue = 'keep'", ":3: outputs.safe.value:", "neither"),
        ("[[outputs.safe]]\nslave = 1\nvalue = 3", ":3: outputs.safe.value:", "needs an entry"),
        ("[[outputs.safe]]\nslave = 1\nvalue = 1.5", ":3: outputs.safe.value:", "whole number"),
        ("[[outputs.safe]]\nslave = 1\nentry = '60FF'", ":3: outputs.safe.entry:", "no address"),
        ("[outputs]\nsafe = [1]", ":2: outputs.safe:", "array of tables"),
    ],
)
def test_wrong_keys_and_values(tmp_path: Path, text: str, where: str, what: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, text)
    assert str(tmp_path / "ecat0.toml") + where in str(caught.value)
    assert what in str(caught.value)


def test_broken_toml_names_file_and_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"ecat0\.toml: is no valid TOML: .*line 2"):
        load(tmp_path, "bus = 'x'\ninterface =\n")


def test_missing_and_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read: No such file"):
        Config.load(tmp_path / "none.toml")
    (tmp_path / "latin.toml").write_bytes(b"bus = '\xe4'")
    with pytest.raises(ConfigError, match="no UTF-8"):
        Config.load(tmp_path / "latin.toml")
