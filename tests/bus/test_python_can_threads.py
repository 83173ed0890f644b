"""Several threads use one bus of python-can; it ends while they do, and by an exception."""

import threading
import time
from collections.abc import Callable

import can
import pytest
from test_can import CONFIG, LEFT, NMT_STOP, RIG, RIGHT

from conftest import PATIENCE, Daemon

pytestmark = pytest.mark.bus

CYCLE_TIME_US = 2000


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon], tmp_path_factory: pytest.TempPathFactory) -> Daemon:
    rig = tmp_path_factory.mktemp("can") / "pair.toml"
    rig.write_text(RIG)
    return start_shared(str(rig), config=CONFIG)


def opened(daemon: Daemon, slave: int) -> can.BusABC:
    return can.Bus(interface="ecatd", channel=f"{daemon.bus}/{slave}")


def frame(identifier: int, data: bytes = b"") -> can.Message:
    return can.Message(arbitration_id=identifier, is_extended_id=False, data=data)


def test_threads_send_beside_a_periodic_task(daemon: Daemon) -> None:
    count, found = 300, {}
    with opened(daemon, LEFT) as left, opened(daemon, RIGHT) as right:
        task = left.send_periodic(frame(0x705), 0.01)
        threads = [
            threading.Thread(
                target=lambda n=n: [
                    left.send(frame(0x100 + n, number.to_bytes(2, "little")))
                    for number in range(count)
                ]
            )
            for n in range(3)
        ]
        for thread in threads:
            thread.start()
        end = time.monotonic() + PATIENCE
        while sum(map(len, found.values())) < 3 * count:
            assert time.monotonic() < end
            message = right.recv(1)
            if message is not None and 0x100 <= message.arbitration_id < 0x103:
                found.setdefault(message.arbitration_id, []).append(bytes(message.data))
        for thread in threads:
            thread.join()
        assert right.recv(PATIENCE).arbitration_id == 0x705, "the task goes on"
        task.stop()
    wanted = [number.to_bytes(2, "little") for number in range(count)]
    assert found == {0x100 + n: wanted for n in range(3)}


def test_a_shutdown_ends_a_thread_that_receives(daemon: Daemon) -> None:
    bus = opened(daemon, LEFT)
    errors: list[Exception] = []

    def receive() -> None:
        try:
            while True:
                bus.recv()
        except can.CanOperationError as error:
            errors.append(error)

    thread = threading.Thread(target=receive)
    thread.start()
    bus.shutdown()
    thread.join(PATIENCE)
    assert not thread.is_alive()
    assert "was shut down" in str(errors[0])


def test_an_exception_is_no_end_in_order(daemon: Daemon) -> None:
    with opened(daemon, LEFT) as watcher:
        with pytest.raises(ZeroDivisionError), opened(daemon, LEFT) as bus:
            bus.send(frame(0x300))
            bus.flush_tx_buffer()
            1 / 0  # noqa: B018
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            message = watcher.recv(1)
            if message and (message.arbitration_id, bytes(message.data)) == NMT_STOP:
                return
    raise AssertionError("no safe frame was sent")


def test_times_of_one_cycle_are_equal_and_times_do_not_go_back(daemon: Daemon) -> None:
    with opened(daemon, LEFT) as left, opened(daemon, RIGHT) as right:
        for number in range(100):
            left.send(frame(0x400, bytes([number])))
        times: list[float] = []
        while len(times) < 100:
            message = right.recv(PATIENCE)
            assert message is not None
            if message.arbitration_id == 0x400:
                times.append(message.timestamp)
    assert times == sorted(times)
    assert len(set(times)) < len(times)
