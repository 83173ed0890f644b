"""What a ROS 2 sees of a bus: a real daemon, the router of the test, and rosbags as the reader.

No ROS 2 runs here: `tests/unit/test_ros_messages.py` has bytes from the sources of rmw_zenoh.
"""

import math
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import xxhash
import zenoh
from rosbags.typesys import Stores, get_typestore

from conftest import PATIENCE, Daemon, free_port, names, naming, run_module, wait_for
from ecatd.operations.zenoh_keys import session_config
from ecatsim.control import Simulator

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

STORE = get_typestore(Stores.ROS2_JAZZY)
# These keys and tokens are written by hand, from liveliness_utils.cpp of rmw_zenoh.
STATES = (
    "5/cell4/joint_states/sensor_msgs::msg::dds_::JointState_/"
    "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"
)
HEALTH = (
    "5/diagnostics/diagnostic_msgs::msg::dds_::DiagnosticArray_/"
    "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"
)
TOKENS = {
    "@ros2_lv/5/{zid}/0/0/NN/%/%cell4/ecatd",
    "@ros2_lv/5/{zid}/0/1/MP/%/%cell4/ecatd/%diagnostics/"
    "diagnostic_msgs::msg::dds_::DiagnosticArray_/"
    "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e/::,10:,:,:,,",
    "@ros2_lv/5/{zid}/0/2/MP/%/%cell4/ecatd/%cell4%joint_states/"
    "sensor_msgs::msg::dds_::JointState_/"
    "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e/::,10:,:,:,,",
}
RIG = str(Path(__file__).parents[1] / "rigs" / "joints.py")
CONFIG = """
[gateway]
listen = []
[[slave]]
position = 0
name = "hip"
[[domain]]
name = "fast"
[[domain]]
name = "slow"
slaves = [2]
{signals}
[ros]
connect = "tcp/127.0.0.1:{port}"
domain_id = 5
namespace = "/cell4"
rate_hz = 20
[[ros.joint]]
slave = "hip"
[[ros.joint]]
slave = "hip"
name = "knee"
axis = 1
[[ros.joint]]
slave = 2
name = "rail"
position = "Position"
"""
UNITS = (
    (0, "0x6064:00", "deg", 0.001),
    (0, "0x606C:00", "rpm", 0.1),
    (0, "0x6864:00", "rev", 1 / 4096),
    (0, "0x686C:00", "rad/s", 1),
    (0, "0x6877:00", "mN.m", 10),
    (1, "0x6064:00", "V", 1),
    (1, "0x606C:00", "mm/s", 1),
    (2, "0x6064:00", "mm", 0.5),
)
SIGNALS = "".join(
    f'[[signal]]\nslave = {slave}\nentry = "{entry}"\nunit = "{unit}"\nscale = {scale!r}\n'
    for slave, entry, unit, scale in UNITS
)
RAW = (
    (0, 0x6064, 90_000),
    (0, 0x606C, -3000),
    (0, 0x6864, 1024),
    (0, 0x686C, 7),
    (0, 0x6877, -150),
    (2, 0x6064, -4000),
)
"""What the slaves send."""


class Ros:
    """The router of a ROS 2, and a session that subscribes to everything as its nodes do."""

    def __init__(self, port: int) -> None:
        address = f"tcp/127.0.0.1:{port}"
        self._router = zenoh.open(session_config("router", {"listen/endpoints": [address]}))
        self._session = zenoh.open(session_config("peer", {"connect/endpoints": [address]}))
        self.samples: dict[str, list[zenoh.Sample]] = {STATES: [], HEALTH: []}
        self.tokens: set[str] = set()
        self._kept = (
            self._session.declare_subscriber("5/**", self._take),
            self._session.liveliness().declare_subscriber("@ros2_lv/5/**", self._see, history=True),
        )

    def _take(self, sample: zenoh.Sample) -> None:
        self.samples[str(sample.key_expr)].append(sample)

    def _see(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self.tokens.add(str(sample.key_expr))
        else:
            self.tokens.discard(str(sample.key_expr))

    def new(self, key: str) -> zenoh.Sample:
        """The next message that comes."""
        count = len(self.samples[key])
        until(lambda: len(self.samples[key]) > count)
        return self.samples[key][count]

    def joints(self) -> dict[str, tuple[float, ...]]:
        """Position, velocity and effort of each joint in the next message."""
        found: Any = STORE.deserialize_cdr(
            bytes(self.new(STATES).payload), "sensor_msgs/msg/JointState"
        )
        columns = (found.position, found.velocity, found.effort)
        return dict(zip(found.name, zip(*columns, strict=True), strict=True))

    def health(self) -> dict[str, tuple[int, str]]:
        """Level and text of each status in the next message, by its name."""
        found: Any = STORE.deserialize_cdr(
            bytes(self.new(HEALTH).payload), "diagnostic_msgs/msg/DiagnosticArray"
        )
        return {item.name: (item.level, item.message) for item in found.status}

    def close(self) -> None:
        self._session.close()
        self._router.close()


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "it does not come about"
        time.sleep(0.02)


@contextmanager
def ros_at(port: int) -> Iterator[Ros]:
    ros = Ros(port)
    try:
        yield ros
    finally:
        ros.close()


@pytest.fixture(scope="module")
def port() -> int:
    return free_port()


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon], port: int) -> Daemon:
    return start_shared(RIG, config=CONFIG.format(port=port, signals=SIGNALS))


def test_joints_have_the_units_of_ros(daemon: Daemon, port: int) -> None:
    with ros_at(port) as ros, Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        for slave, index, raw in RAW:
            simulator.set(slave, index, 0, raw)
        until(lambda: ros.joints()["rail"][0] != 0)
        joints = ros.joints()
        assert list(joints) == ["hip", "knee", "rail"]
        # 90°, -300 rpm, and a torque without unit; a quarter of a turn, 7 rad/s, -1500 mN.m
        assert joints["hip"] == pytest.approx((math.pi / 2, -10 * math.pi, math.nan), nan_ok=True)
        assert joints["knee"] == pytest.approx((math.pi / 2, 7, -1.5))
        # -2000 mm. What a joint does not have is NaN, if another one has it.
        assert joints["rail"] == pytest.approx((-2, math.nan, math.nan), nan_ok=True)


def test_tokens_and_attachments(daemon: Daemon, port: int) -> None:
    with ros_at(port) as ros:
        first, second = ros.new(STATES), ros.new(STATES)
        until(lambda: len(ros.tokens) == len(TOKENS))
        zid = next(iter(ros.tokens)).split("/")[2]
        assert ros.tokens == {token.format(zid=zid) for token in TOKENS}
        (token,) = (token for token in ros.tokens if "joint_states" in token)
        numbers = []
        for sample in (first, second):
            data = bytes(sample.attachment or b"")
            assert len(data) == 33
            # GID: lower half of the hash first, each half little-endian (`Entity::Entity`).
            hashed = xxhash.xxh3_128(token.encode()).intdigest()
            assert data[16:] == b"\x10" + hashed.to_bytes(16, "little")
            numbers.append(int.from_bytes(data[:8], "little"))
            assert abs(int.from_bytes(data[8:16], "little") / 1e9 - time.time()) < PATIENCE
            assert sample.encoding == zenoh.Encoding.ZENOH_BYTES
        assert numbers[1] == numbers[0] + 1
        stamps = [
            STORE.deserialize_cdr(bytes(item.payload), "sensor_msgs/msg/JointState").header.stamp
            for item in (first, second)
        ]
        assert stamps[0].sec + stamps[0].nanosec * 1e-9 < stamps[1].sec + stamps[1].nanosec * 1e-9


def test_health_of_the_bus_and_of_its_slaves(daemon: Daemon, port: int) -> None:
    with ros_at(port) as ros:
        until(lambda: ros.health()[f"ecatd: bus {daemon.bus}"][0] == 0)
        health = ros.health()
        assert health[f"ecatd: bus {daemon.bus} slave 0 hip"] == (0, "OP")
        assert len([name for name in health if " slave " in name]) == 3
        # The torque of the drive has no unit: the reason says how to mend it.
        level, text = health[f"ecatd: bus {daemon.bus} joints"]
        assert level == 1
        names(text, "hip", "effort", "N.m", "[[signal]]")
        names(daemon.log, "hip", "effort", "N.m", "[[signal]]")


def test_values_that_cannot_be_trusted_are_not_published(daemon: Daemon, port: int) -> None:
    """A slave that is not in OP: its joint is left out, and the others go on."""
    with ros_at(port) as ros:
        until(lambda: "rail" in ros.joints())
        daemon.ctl("state", "2", "PREOP", "--yes")
        try:
            until(lambda: list(ros.joints()) == ["hip", "knee"])
            until(lambda: ros.health()[f"ecatd: bus {daemon.bus} slave 2 Axis"][0] == 2)
            health = ros.health()
            assert health[f"ecatd: bus {daemon.bus}"][0] == 2
            assert "rail" in health[f"ecatd: bus {daemon.bus} joints"][1]
        finally:
            daemon.ctl("state", "2", "OP", "--yes")
        until(lambda: "rail" in ros.joints())


def test_it_has_no_rights_and_listens_nowhere(daemon: Daemon, port: int) -> None:
    process = Path(f"/proc/{daemon.child_pid('ecatd.ros')}")
    with ros_at(port) as ros:
        ros.joints()
        status = dict(
            line.split(":\t", 1) for line in (process / "status").read_text().splitlines()
        )
        assert int(status["CapEff"], 16) == int(status["CapPrm"], 16) == 0
        assert status["NoNewPrivs"] == "1"
        sockets = set()
        for item in (process / "fd").iterdir():
            flags = int(
                re.search(r"flags:\s+(\d+)", (process / "fdinfo" / item.name).read_text())[1], 8
            )
            name = str(item.readlink())
            sockets.add(name)
            # Outputs are claimed by writing into the file of the clients.
            assert "/dev/shm/" not in name or flags & os.O_ACCMODE == os.O_RDONLY, name
        for table in ("tcp", "tcp6", "udp", "udp6"):
            for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
                state, inode = line.split()[3], line.split()[9]
                assert f"socket:[{inode}]" not in sockets or state == "01", line  # connected


def test_the_router_comes_and_goes(daemon: Daemon, port: int) -> None:
    for _ in range(2):
        with ros_at(port) as ros:
            ros.joints()
            until(lambda ros=ros: len(ros.tokens) == len(TOKENS))
        count = daemon.log.count("no Zenoh router of ROS 2")
        wait_for(lambda c=count: daemon.log.count("no Zenoh router of ROS 2") >= c, daemon)
    with daemon.client() as client:
        client.wait(3)


def test_who_is_no_router_is_not_taken_for_one(start_daemon: Callable[..., Daemon]) -> None:
    """A peer, such as a gateway of ecatd, passes nothing on."""
    port = free_port()
    listen = {"listen/endpoints": [f"tcp/127.0.0.1:{port}"]}
    with zenoh.open(session_config("peer", listen)):
        config = f"[gateway]\nlisten = []\n[ros]\nconnect = 'tcp/127.0.0.1:{port}'\n"
        daemon = start_daemon("line:1", config=config)
        wait_for(
            lambda: f"no Zenoh router of ROS 2 is reached at tcp/127.0.0.1:{port}" in daemon.log,
            daemon,
        )


def test_it_is_killed_and_started_again(daemon: Daemon, port: int) -> None:
    with ros_at(port) as ros:
        until(lambda: len(ros.tokens) == len(TOKENS))
        before, pid = set(ros.tokens), daemon.child_pid("ecatd.ros")
        with daemon.client() as client:
            client.sample()
            cycle = client.cycle
            os.kill(pid, signal.SIGKILL)
            until(lambda: len(ros.tokens) == len(TOKENS) and not ros.tokens & before)
            ros.joints()
            client.sample()
            assert client.cycle > cycle
    wait_for(lambda: "the node of ROS 2 has ended" in daemon.log, daemon)


def test_the_daemon_ends_and_comes_again(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    """The node is a service of its own here, so ROS 2 sees that the bus has gone."""
    port = free_port()
    config = CONFIG.format(port=port, signals=SIGNALS)
    daemon = start_daemon(RIG, "--no-gateway", config=config)
    with pytest.raises(AssertionError, match=naming("ecatd.ros")):
        daemon.child_pid("ecatd.ros")
    file = tmp_path / "ros.toml"
    file.write_text(config)
    arguments = ("--only-ros", "--config", str(file), "--bus", daemon.bus)
    command = [sys.executable, "-m", "ecatd.service", *arguments]
    log = (tmp_path / "ros.log").open("w+")
    node = subprocess.Popen(command, env=daemon.env, stderr=log, text=True)
    try:
        with ros_at(port) as ros:
            until(lambda: "knee" in ros.joints())
            tokens = set(ros.tokens)
            assert daemon.stop() == 0
            until(lambda: ros.health()[f"ecatd: bus {daemon.bus}"][0] == 2)
            count = len(ros.samples[STATES])
            assert list(ros.health()) == [f"ecatd: bus {daemon.bus}"]
            assert len(ros.samples[STATES]) == count
            start_daemon(RIG, "--no-gateway", "--bus", daemon.bus, config=config)
            until(lambda: len(ros.samples[STATES]) > count)
            assert list(ros.joints()) == ["hip", "knee", "rail"]
            until(lambda: ros.health()[f"ecatd: bus {daemon.bus}"][0] == 0)
            assert ros.tokens == tokens
    finally:
        node.terminate()
        assert node.wait(PATIENCE) == 0
        log.close()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), ("--config",)),
        (("--config", "{file}"), ("[ros]", "connect")),
        (("--config", "{file}", "--no-gateway"), ("--no-gateway", "--only-ros")),
    ],
)
def test_a_node_without_a_router_does_not_start(
    tmp_path: Path, arguments: tuple[str, ...], words: tuple[str, ...]
) -> None:
    file = tmp_path / "empty.toml"
    file.write_text("")
    found = run_module(
        "ecatd.service", "--only-ros", *(word.format(file=file) for word in arguments)
    )
    assert found.returncode == 2
    names(found.stderr, *words)


WRONG = """
[gateway]
listen = []
{signals}
[ros]
connect = "tcp/127.0.0.1:{port}"
domain_id = 5
[[ros.joint]]
slave = "nobody"
[[ros.joint]]
slave = 2
name = "a"
position = "0x7000:00"
[[ros.joint]]
slave = 0
name = "b"
position = "0x6064:00"
[[ros.joint]]
slave = 2
name = "c"
velocity = "0x6064:00"
[[ros.joint]]
slave = 0
name = "b"
axis = 1
[[ros.joint]]
slave = 2
name = "d"
axis = 1
[[ros.joint]]
slave = 1
name = "e"
[[ros.joint]]
slave = 0
name = "f"
position = "Axis 0/Position"
velocity = "Axis 1/Velocity"
"""


def test_what_is_wrong_is_named_and_the_rest_is_published(
    start_daemon: Callable[..., Daemon],
) -> None:
    port = free_port()
    daemon = start_daemon(RIG, config=WRONG.format(port=port, signals=SIGNALS))
    states = STATES.replace("cell4/", "")
    with ros_at(port) as ros:
        ros.samples[states] = ros.samples.pop(STATES)
        found: Any = STORE.deserialize_cdr(
            bytes(ros.new(states).payload), "sensor_msgs/msg/JointState"
        )
        assert (found.name, len(found.velocity), len(found.effort)) == (["b", "e", "f"], 3, 0)
        level, text = ros.health()[f"ecatd: bus {daemon.bus} joints"]
    assert level == 1
    names(text, "ros.joint[0]", "nobody")
    names(text, "ros.joint[1]", "0x7000:00")
    names(text, "the velocity of joint 'c'", "mm", "rad/s", "m/s")
    names(text, "ros.joint[4]", "another joint has the name 'b'")
    names(text, "ros.joint[5]", "0x6864:00")
    names(text, "the position of joint 'e'", "V", "rad", "m")
    names(daemon.log, "ros.joint[0]", "nobody")
