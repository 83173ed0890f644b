"""Models on a CAN bus: what they receive and send, beside others, and when they or the bus end."""

from __future__ import annotations

import contextlib
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from conftest import Daemon, names
from ecatd.shm.contract import CanState

sys.path.insert(0, str(Path(__file__).parents[1] / "contract"))

from can_client import CONFIG, SAFE, Others, motor
from can_messages import COMMAND, DBC, MOTOR, PROGRAM
from plant_calls import CONTINUE, ERROR, compile_program

pytestmark = pytest.mark.bus


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared("troll-can", config=CONFIG)


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory, daemon: Daemon, compiler: str) -> Path:
    folder = tmp_path_factory.mktemp("plant")
    dbc = folder / "motor.dbc"
    dbc.write_text(DBC)
    daemon.ctl("generate", "Plant", str(folder), "--can", f"canTerminal={dbc}@ECU")
    return compile_program(compiler, PROGRAM, folder, folder)


@dataclass(frozen=True)
class Step:
    cycle: int
    valid: bool
    speed: float
    page: int
    temperature: float
    voltage: float
    torque: float
    motor_valid: bool
    age: float
    count: int
    sent: int
    state: int


class Model:
    """The program, one sample after the other."""

    def __init__(
        self, program: Path, bus: str, lease: float = 30.0, failed: int = CONTINUE
    ) -> None:
        self.process = subprocess.Popen(
            [str(program), bus, "0.008", str(lease), str(failed)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.time = 0.0
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "open\n", self.end()

    def step(self, target: float = 0, enable: int = 0, model: int = 0, repeat: int = 1) -> Step:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.time += 0.008
        self.process.stdin.write(f"{self.time:.6f} {target!r} {enable} {model} {repeat}\n")
        self.process.stdin.flush()
        words = self.process.stdout.readline().split()
        assert words, self.end()
        numbers = [*map(float, words)]
        return Step(
            *(int(numbers[0]), bool(numbers[1]), numbers[2], int(numbers[3]), *numbers[4:7]),
            *(bool(numbers[7]), numbers[8], *map(int, numbers[9:])),
        )

    def until(self, condition: Callable[[Step], bool], **values: float) -> Step:
        deadline = time.monotonic() + 120
        while not condition(step := self.step(**values)):
            assert time.monotonic() < deadline, step
        return step

    def end(self) -> str:
        _, said = self.process.communicate()
        return said

    def close(self) -> None:
        """Ends it in order, so that no safe frames follow in the next test."""
        assert self.process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.close()
        self.process.wait()
        for stream in (self.process.stdout, self.process.stderr):
            assert stream is not None
            stream.close()


@pytest.fixture
def start(program: Path, daemon: Daemon) -> Iterator[Callable[..., Model]]:
    models: list[Model] = []

    def begin(**options: float) -> Model:
        models.append(Model(program, daemon.bus, **options))
        return models[-1]

    yield begin
    for model in models:
        model.close()


@pytest.fixture
def others(daemon: Daemon) -> Iterator[Others]:
    client = Others(daemon.bus)
    client.channel.claim()
    yield client
    client.close()


def test_a_frame_of_another_client_is_received_with_all_its_signals(
    start: Callable[..., Model], others: Others
) -> None:
    model = start()
    first = model.step()
    assert first.valid
    assert (first.motor_valid, first.count, first.age) == (False, 0, 1e9)
    others.send(MOTOR, motor(-1234.5, 1, 65, 2.5))
    step = model.until(lambda step: step.count == 1)
    assert step.motor_valid
    assert (step.speed, step.page, step.temperature, step.torque) == (-1234.5, 1, 25, 2.5)
    assert step.voltage == 0, "it is in frames with page 2 only"
    assert step.age < 60
    others.send(MOTOR, motor(10, 2, 48, 0))
    step = model.until(lambda step: step.count == 2)
    assert (step.speed, step.page, step.temperature, step.voltage) == (10, 2, 25, 24)


def test_frames_that_are_too_short_are_left_out_and_said_once(
    start: Callable[..., Model], others: Others
) -> None:
    model = start()
    model.step()
    others.send(MOTOR, b"\1\2")
    others.send(MOTOR, b"\1\2")
    others.send(MOTOR, motor(1, 0, 0, 0))
    step = model.until(lambda step: step.count == 1)
    assert step.speed == 1
    said = model.end()
    (line,) = [line for line in said.splitlines() if "0x181" in line]
    names(line, "2 bytes", "8", "canTerminal")


def test_a_changed_message_is_sent_once_however_often_an_instant_is_evaluated(
    start: Callable[..., Model], others: Others
) -> None:
    model = start()
    for _ in range(3):
        model.step(target=1.5, enable=1, model=-3, repeat=4)
    model.until(lambda step: step.sent == 1, target=1.5, enable=1, model=-3, repeat=2)
    last = model.step(target=-0.25, model=5, repeat=3)
    assert last.sent == 2
    others.wait(lambda: len(others.frames(COMMAND)) >= 2)
    for _ in range(5):
        assert model.step(target=-0.25, model=5).sent == 2
    one, other = others.frames(COMMAND)
    assert one.extended
    assert one.data == struct.pack("<iBb", 1500, 1, -3) + b"\0\0"
    assert other.data == struct.pack("<iBb", -250, 0, 5) + b"\0\0"


def test_the_last_frames_of_a_model_that_ends_in_order_are_sent(
    start: Callable[..., Model], others: Others
) -> None:
    before = len(others.frames(COMMAND))
    dropped = others.channel.info.dropped
    model = start()
    sent = model.until(lambda step: step.sent == 1, target=1).sent
    for target in range(2, 40):
        sent = model.step(target=target).sent
    model.close()
    others.wait(lambda: len(others.frames(COMMAND)) - before >= sent)
    assert others.channel.info.dropped == dropped


def test_what_the_model_sends_is_not_received_by_itself(
    start: Callable[..., Model], others: Others, program: Path
) -> None:
    model = start()
    count = len(others.frames(MOTOR))
    model.until(lambda step: step.sent == 1, target=2)
    assert model.step(target=2).count == 0
    assert len(others.frames(MOTOR)) == count


def test_a_physical_value_is_cut_to_its_limits_and_another_one_is_refused(
    start: Callable[..., Model], others: Others
) -> None:
    model = start()
    model.until(lambda step: step.sent == 1, target=1e6)
    others.wait(lambda: others.frames(COMMAND))
    assert others.frames(COMMAND)[-1].data[:4] == struct.pack("<i", 100_000)
    with pytest.raises(AssertionError) as refused:
        model.step(model=6)
    names(str(refused.value), "6", "model", "-5 to 5", "0x18FEF1FE", "slave 7")
    others.wait(lambda: others.frames(SAFE))  # the model has ended by itself, and not in order


def test_a_model_that_hangs_is_noticed_and_sends_again_when_it_goes_on(
    start: Callable[..., Model], others: Others
) -> None:
    model = start(lease=3)
    model.until(lambda step: step.sent == 1, target=3)
    others.wait(lambda: others.frames(COMMAND))
    model.process.send_signal(signal.SIGSTOP)
    others.wait(lambda: others.frames(SAFE))
    assert others.frames(SAFE)[0].safe
    before = len(others.frames(COMMAND))
    model.process.send_signal(signal.SIGCONT)
    model.until(lambda step: step.sent == 2, target=3)
    others.wait(lambda: len(others.frames(COMMAND)) > before)


def test_a_model_that_is_killed_is_noticed(start: Callable[..., Model], others: Others) -> None:
    model = start()
    model.until(lambda step: step.sent == 1, target=4)
    others.wait(lambda: others.frames(COMMAND))
    model.process.kill()
    others.wait(lambda: others.frames(SAFE))


def test_a_lost_lease_is_an_error_if_the_model_wants_that(start: Callable[..., Model]) -> None:
    model = start(lease=0.5, failed=ERROR)
    model.until(lambda step: step.sent == 1, target=4)
    model.process.send_signal(signal.SIGSTOP)
    time.sleep(2)
    model.process.send_signal(signal.SIGCONT)
    with pytest.raises(AssertionError) as ended:
        model.until(lambda step: False, target=4)
    names(str(ended.value), "slave 7", "whenFailed", "lease")


def test_an_identifier_that_another_client_has_reserved(
    start: Callable[..., Model], others: Others
) -> None:
    others.channel.claim(reserve=[COMMAND])
    model = start()
    with pytest.raises(AssertionError) as refused:
        model.until(lambda step: False, target=1)
    names(str(refused.value), "0x18FEF1FE", "reserved", "slave 7")


def test_a_terminal_that_leaves_op_and_comes_back(
    start: Callable[..., Model], others: Others, daemon: Daemon
) -> None:
    model = start()
    model.step(target=5)
    others.send(MOTOR, motor(7, 0, 0, 0))
    assert model.until(lambda step: step.count == 1 and step.sent == 1, target=5).motor_valid
    daemon.ctl("state", "canTerminal", "SAFEOP", "--yes")
    step = model.until(lambda step: not step.valid, target=5)
    assert (step.motor_valid, step.speed) == (False, 7)
    assert model.until(lambda step: step.state == CanState.STOPPED + 1, target=5).sent == 1
    daemon.ctl("state", "canTerminal", "OP")
    step = model.until(lambda step: step.state == CanState.ACTIVE + 1 and step.sent == 2, target=5)
    assert not step.motor_valid, "it is not known whether the value is still true"
    others.send(MOTOR, motor(8, 0, 0, 0))
    step = model.until(lambda step: step.count == 2, target=5)
    assert (step.motor_valid, step.speed) == (True, 8)


def test_the_daemon_is_started_again(
    start_daemon: Callable[..., Daemon], program: Path, daemon: Daemon
) -> None:
    own = start_daemon("troll-can", config=CONFIG)
    model = Model(program, own.bus)
    try:
        model.until(lambda step: step.sent == 1, target=1)
        own.stop()
        model.until(lambda step: not step.valid, target=2)
        start_daemon("troll-can", "--bus", own.bus, config=CONFIG)
        other = Others(own.bus)
        other.channel.claim()
        model.until(lambda step: step.sent == 2, target=2)
        other.wait(lambda: other.frames(COMMAND))
        other.send(MOTOR, motor(9, 0, 0, 0))
        assert model.until(lambda step: step.count == 1, target=2).speed == 9
        other.close()
    finally:
        model.close()
