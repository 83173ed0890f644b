"""Models without a bus: at the start, in the middle, and with another one; made from C."""

import os
import signal
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from plant_calls import (
    CONTINUE,
    ERROR,
    INCOMPLETE,
    MISSING,
    NOT_AVAILABLE,
    NOT_OPERATIONAL,
    OP,
    OPERATIONAL,
    SAFEOP,
    STANDS_STILL,
    STEPS,
    WAIT,
    Model,
    Step,
    compile_program,
)

from conftest import Daemon, names, naming
from ecatsim.control import Simulator

pytestmark = [pytest.mark.bus, pytest.mark.long]

ODD_NAMES = str(Path(__file__).parents[1] / "rigs" / "odd_names.py")
DRIVE, DIGITAL_INPUTS, DIGITAL_OUTPUTS = 0, 2, 3
MORE_SLAVES = """
from ecatsim.devices.beckhoff import EL1018
from ecatsim.rigs import troll

def rig():
    result = troll.rig()
    result.devices.append(EL1018())
    return result
"""

Start = Callable[..., Model]


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory, troll: Daemon) -> Path:
    """The library for the rig `troll`."""
    folder = tmp_path_factory.mktemp("live")
    troll.ctl("generate", "Plant", str(folder))
    return folder


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory, compiler: str, live: Path) -> Path:
    folder = tmp_path_factory.mktemp("program")
    sanitize = ("-fsanitize=address,undefined", "-static-libasan")
    return compile_program(compiler, STEPS, live, folder, *sanitize)


@pytest.fixture
def model(program: Path) -> Iterator[Start]:
    """Starts models: bus, whenMissing, whenFailed, patience, waitForBus, lease."""
    models: list[Model] = []

    def start(
        bus: str,
        missing: int,
        failed: int,
        patience: float = 0,
        *,
        wait_for_bus: bool = False,
        lease: float = 30,
    ) -> Model:
        numbers = (int(wait_for_bus), missing, failed, patience, 0, 0, lease)
        models.append(Model(program, bus, *map(str, numbers)))
        return models[-1]

    yield start
    for model in models:
        model.close()


@pytest.fixture
def name() -> str:
    """Of a bus that nobody serves yet."""
    return f"t{uuid.uuid4().hex[:10]}"


@pytest.fixture
def serve(start_daemon: Callable[..., Daemon]) -> Callable[..., Daemon]:
    """Starts a daemon for a bus of this name."""

    def serve(name: str, rig: str = "troll", **options: str) -> Daemon:
        daemon = start_daemon(rig, "--bus", name, **options)
        daemon.bus = name
        return daemon

    return serve


def operational(step: Step) -> bool:
    return step.state == OPERATIONAL and step.valid


def written(step: Step) -> bool:
    return operational(step) and step.input


def test_a_model_goes_on_without_a_bus_until_there_is_one(
    model: Start, name: str, serve: Callable[..., Daemon]
) -> None:
    running = model(name, CONTINUE, ERROR).opened()
    for _ in range(50):
        step = running.step(1)
        assert (step.connected, step.state, step.valid) == (False, MISSING, False)
        assert (step.al_state, step.al_status_code) == (NOT_AVAILABLE, 0)
        assert (step.cycle, step.age, step.counter) == (0, 1e9, 0)
        assert (step.input, step.analog) == (0, 0)
    serve(name)
    step = running.until(operational, 1)
    assert (step.connected, step.al_state, step.al_status_code) == (True, OP, 0)
    assert step.counter == step.expected > 0
    assert step.cycle > 0
    assert running.until(written, 1).analog
    status, said = running.end()
    assert status == 0
    lines = said.splitlines()
    assert all(line.startswith("EtherCAT: ") for line in (lines[0], lines[-1])), said
    names(
        lines[0],
        f"'{name}'",
        f"'systemctl start ecatd@{name}'",
        f"'ecatd --simulate troll --bus {name}'",
        "goes on",
    )
    names(lines[-1], f"'{name}'", "is there")


def test_the_end_of_the_daemon(model: Start, start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    running = model(daemon.bus, ERROR, ERROR).opened()
    running.until(written, 1)
    daemon.kill_all()
    with pytest.raises(AssertionError, match=r"has ended|stands still since"):
        running.until(lambda step: not step.connected)


def test_values_and_diagnostics_while_there_is_no_bus(
    model: Start, name: str, serve: Callable[..., Daemon]
) -> None:
    daemon = serve(name)
    running = model(name, ERROR, CONTINUE).opened()
    last = running.until(written, 1)
    daemon.kill_all()
    step = running.until(lambda step: step.state == MISSING)
    assert (step.connected, step.valid, step.al_state) == (False, False, NOT_AVAILABLE)
    assert (step.counter, step.expected) == (0, last.expected)
    assert (step.input, step.analog) == (True, True)  # the last ones
    later = running.step(0)
    assert later.cycle == step.cycle >= last.cycle
    assert later.age > step.age > 0
    serve(name)
    assert not running.until(operational, 0).input
    running.until(written, 1)
    assert running.end()[0] == 0


def test_a_cycle_that_stands_still(model: Start, name: str, serve: Callable[..., Daemon]) -> None:
    daemon = serve(name)
    running = model(name, ERROR, CONTINUE).opened()
    running.until(written, 1)
    server = daemon.child_pid("ecatd.server")
    os.kill(server, signal.SIGSTOP)
    try:
        step = running.until(lambda step: not step.connected)
    finally:
        os.kill(server, signal.SIGCONT)
    assert (step.state, step.valid, step.counter) == (STANDS_STILL, False, 0)
    running.until(written, 1)
    assert "stands still since" in running.end()[1]


def test_a_model_waits_for_the_bus_at_the_start(
    model: Start, name: str, serve: Callable[..., Daemon]
) -> None:
    running = model(name, WAIT, ERROR)
    running.send(1)
    serve(name)
    assert running.opened().receive().connected
    running.until(written, 1)
    status, said = running.end()
    assert status == 0
    waits, *_, there = said.splitlines()
    names(waits, "EtherCAT: ", "not running", f"'{name}'", "waits")
    names(there, "EtherCAT: ", f"'{name}'", "is there")


def test_patience_ends(model: Start, name: str) -> None:
    running = model(name, WAIT, ERROR, 0.05)
    status, said = running.end()
    assert status == 1
    first, last = said.splitlines()
    names(first, "waits", "0.05 s")
    names(
        last,
        "EtherCAT: ",
        "not running",
        f"'{name}'",
        f"'systemctl start ecatd@{name}'",
        "patience",
    )


@pytest.mark.parametrize("wait_for_bus", [False, True])
def test_a_model_waits_for_a_daemon_that_comes_back(
    model: Start, name: str, serve: Callable[..., Daemon], wait_for_bus: bool
) -> None:
    daemon = serve(name)
    running = model(name, ERROR, WAIT, wait_for_bus=wait_for_bus).opened()
    running.until(written, 1)
    daemon.kill_all()
    for _ in range(1000):  # a daemon that is gone is noticed within a tenth of a second
        running.send(1)
    serve(name)
    steps = [running.receive() for _ in range(1000)]
    assert all(step.connected for step in steps)
    running.until(written, 1)
    status, said = running.end()
    assert status == 0
    assert "the model waits for it" in said


@pytest.mark.parametrize("failed", [WAIT, CONTINUE])
def test_lost_outputs_are_claimed_again(model: Start, troll: Daemon, failed: int) -> None:
    running = model(troll.bus, ERROR, failed, lease=1).opened()
    running.until(written, 1)
    pause(troll)
    running.until(written, 1)
    status, said = running.end()
    assert status == 0
    names(said, "EtherCAT: ", "lost its outputs", "claimed them again")


def test_lost_outputs_are_an_error_by_default(model: Start, troll: Daemon) -> None:
    running = model(troll.bus, ERROR, ERROR, lease=1).opened()
    # Sooner than in the pause on a busy machine.
    with pytest.raises(AssertionError, match=naming("lost its outputs")):
        running.until(written, 1)
        pause(troll)
        running.step(1)


def pause(daemon: Daemon) -> None:
    """Until the outputs of the model, which takes no samples meanwhile, are safe."""
    with daemon.client() as client:
        wired = client.signal(DIGITAL_INPUTS, 0x6000, 1)
        client.sample()
        while wired.raw:
            client.wait(1)
            client.sample()


@pytest.mark.parametrize("rig", [ODD_NAMES, "line:4"])
@pytest.mark.parametrize("missing", [WAIT, CONTINUE])
def test_r45_a_wrong_bus_that_appears_is_an_error(
    model: Start, name: str, serve: Callable[..., Daemon], rig: str, missing: int
) -> None:
    running = model(name, missing, CONTINUE)
    if missing == CONTINUE:
        assert not running.opened().step().connected
    serve(name, rig)
    with pytest.raises(AssertionError, match=naming(name, "generated for")):
        running.opened() if missing == WAIT else running.until(lambda step: step.connected)


@pytest.mark.parametrize("failed", [WAIT, CONTINUE])
def test_a_bus_that_comes_back_as_a_wrong_one_is_an_error(
    model: Start, name: str, serve: Callable[..., Daemon], failed: int
) -> None:
    daemon = serve(name)
    running = model(name, ERROR, failed).opened()
    running.until(written, 1)
    daemon.kill_all()
    serve(name, ODD_NAMES)
    with pytest.raises(AssertionError, match=naming(name, "generated for")):
        running.until(lambda step: step.state in (MISSING, OPERATIONAL))
        running.until(lambda step: step.connected)


def test_a_bus_that_comes_back_with_more_slaves_is_used(
    model: Start, name: str, serve: Callable[..., Daemon], tmp_path: Path
) -> None:
    more = tmp_path / "more.py"
    more.write_text(MORE_SLAVES)
    daemon = serve(name)
    running = model(name, ERROR, CONTINUE).opened()
    before = running.until(written, 1)
    daemon.kill_all()
    running.until(lambda step: not step.connected)
    serve(name, str(more))
    assert running.until(written, 1).expected > before.expected
    assert running.end()[0] == 0


@pytest.mark.parametrize("failed", [ERROR, WAIT, CONTINUE])
def test_outputs_of_somebody_else_are_an_error(model: Start, troll: Daemon, failed: int) -> None:
    with troll.client() as owner:
        owner.claim(DRIVE, lease=30)  # the first one that the model writes
        running = model(troll.bus, ERROR, failed).opened()
        running.send(1)
        running.send(1)
        while running.running:
            owner.sample()
    status, said = running.end()
    assert status == 1
    assert "belongs to" in said.splitlines()[-1]


def test_without_a_bus_the_clock_paces_a_model_that_waits_for_it(model: Start, name: str) -> None:
    running = model(name, CONTINUE, CONTINUE, wait_for_bus=True).opened()
    steps = [running.step() for _ in range(200)]
    assert steps[-1].clock - steps[0].clock > 0.198  # the last one may not come too early
    assert steps[-1].missed == 0


def test_samples_that_come_too_late_for_their_cycle_are_counted(
    model: Start, troll: Daemon
) -> None:
    running = model(troll.bus, ERROR, ERROR, wait_for_bus=True).opened()
    before = running.until(operational, 0)
    with troll.client() as client:
        for _ in range(50):
            client.wait(1)
    late = running.step()
    assert late.missed >= before.missed + 48  # waits of a client and of a model begin apart
    assert late.cycle >= before.cycle + 50
    assert running.end()[0] == 0


RECOVERY = '[gateway]\nlisten = []\n[recovery]\nslaves = "none"\n'


def test_slaves_that_are_not_in_op(
    model: Start, name: str, serve: Callable[..., Daemon], tmp_path: Path
) -> None:
    daemon = serve(name, config=RECOVERY)
    running = model(name, ERROR, ERROR).opened()
    running.until(operational)
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        simulator.faults.al_error(DIGITAL_INPUTS, code=0x001B)
        step = running.until(lambda step: step.state == NOT_OPERATIONAL)
        assert (step.connected, step.valid, step.al_state) == (True, False, SAFEOP)
        assert step.al_status_code == 0x001B
        simulator.faults.power_off(DIGITAL_OUTPUTS)
        step = running.until(lambda step: step.state == INCOMPLETE)
        assert (step.connected, step.valid) == (True, False)
        assert step.counter < step.expected
    assert running.end()[0] == 0
