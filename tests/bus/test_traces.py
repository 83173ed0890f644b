"""Traces: what the frames say of each cycle is what the engine has given to its clients."""

import contextlib
import csv
import os
import random
import re
import signal
import threading
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from conftest import CYCLE_TIME_US, PATIENCE, Daemon, free_port, names, wait_for
from ecatd.base.errors import BusyError, LeaseError, StateError, UnreachableError, UsageError
from ecatd.client.patterns import find_signals
from ecatd.client.remote import Remote
from ecatd.client.trace import Batch, Trace
from ecatd.operations.traces import ReadHistory
from ecatd.shm.contract import Validity
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus
RIGS = Path(__file__).parents[1] / "rigs"
LOCAL = "[gateway]\nlisten = []\n"
TOOK_PART = {Validity.VALID, Validity.NOT_OPERATIONAL}
"""Frames do not say the AL state of a slave. A client knows it, some time later."""
ENOUGH = 300
"""Cycles that are compared."""

MIXED = f"""
cycle_time_us = 4000
{LOCAL}
[[domain]]
name = "fast"
[[domain]]
divider = 4
slaves = ["4-33"]
[[domain]]
divider = 10
slaves = [34, "35-39"]
"""
"""The second domain is larger than a frame, and some slaves cannot do LRW."""

RING = "name = 'ring'\nring = true\n" + "[[slave]]\ndevice = 'Loopback32'\n" * 5
OPTIONAL = f"""
{LOCAL}
[recovery]
retry_s = 0.5
[[slave]]
position = 2
vendor = 0xFFFF
product = 0x3232
optional = true
"""


def remote(daemon: Daemon) -> Remote:
    folder = daemon.env["ECATD_RUNTIME_DIR"]
    return Remote(daemon.bus, f"unixsock-stream/{folder}/{daemon.bus}/gateway/zenoh", timeout=60)


class Samples:
    """What a client sees as often as it gets the processor, while it writes outputs.

    Attributes:
        seen: Raw value and validity of each entry, by domain and cycle of the exchange.
    """

    def __init__(self, daemon: Daemon, patterns: list[str]) -> None:
        self.seen: dict[tuple[int, int], dict[int, tuple[float, bool]]] = {}
        self._client = daemon.client()
        self._entries = find_signals(self._client, patterns)
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> "Samples":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._thread.join()
        self._client.close()

    def _run(self) -> None:
        chance = random.Random(1)
        client, outputs = self._client, [entry for entry in self._entries if entry.output]
        claim = None
        while not self._ends.is_set():
            with contextlib.suppress(LeaseError, StateError, UnreachableError):
                client.wait()
                client.sample()
                self._note()
                claim = claim or client.claim(outputs, lease=30)
                for entry in outputs:
                    entry.raw = chance.randrange(1 << entry.bit_length)
                client.commit()

    def _note(self) -> None:
        for domain in {entry.domain for entry in self._entries}:
            self.seen.setdefault(
                (domain, self._client.domain(domain).cycle),
                {
                    place: (entry.raw, entry.output or entry.validity in TOOK_PART)
                    for place, entry in enumerate(self._entries)
                    if entry.domain == domain
                },
            )


def compare(daemon: Daemon, *patterns: str) -> tuple[int, int]:
    """Compares a trace with what a client sees meanwhile.

    Returns:
        How many exchanges were the same, and how many entries of them were not valid.
    """
    with remote(daemon) as session, session.trace(patterns) as trace:
        found: dict[int, tuple[Batch, int]] = {}
        with Samples(daemon, [*patterns]) as samples:
            for batch in trace:
                assert not batch.lost
                found |= {cycle: (batch, at) for at, cycle in enumerate(batch.cycles)}
                if len(samples.seen.keys()) > ENOUGH and len(found) > ENOUGH:
                    break
    return check(samples, found, trace, daemon)


def check(
    samples: Samples, found: Mapping[int, tuple[Batch, int]], trace: Trace, daemon: Daemon
) -> tuple[int, int]:
    """Compares cycles of a trace, each in its batch, with what a client saw; see `compare`."""
    same = invalid = 0
    for (_, cycle), entries in samples.seen.items():
        if cycle not in found:
            continue
        batch, at = found[cycle]
        is_complete = all(is_valid for _, is_valid in entries.values())
        for place, (raw, is_valid) in entries.items():
            signal = trace.signals[place]
            if signal["output"] and not is_complete:
                continue  # not sent in full, so the trace may have older ones
            assert batch.columns[place][at] == raw, (cycle, signal, daemon.log)
            assert (at not in batch.invalid.get(place, ())) == is_valid, (cycle, signal)
            invalid += not is_valid
        same += 1
    return same, invalid


def test_a_trace_has_what_clients_see(start_daemon: Callable[..., Daemon]) -> None:
    """With domains at several rates, and datagrams of several kinds."""
    daemon = start_daemon(str(RIGS / "domains.py"), config=MIXED)
    patterns = [f"{slave}/*:0[1-4]" for slave in (0, 1, 4, 10, 33, 34, 39)]
    assert compare(daemon, *patterns)[0] > ENOUGH // 2
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        simulator.faults.drop(all_frames=True, count=0, probability=0.03)
        simulator.faults.drop(all_frames=True, count=0, probability=0.03, seed=2, way_back=True)
        same, invalid = compare(daemon, *patterns)
    assert same > ENOUGH // 2
    assert invalid > 10


def test_history_is_what_a_client_saw_and_live_cycles_follow_without_a_gap(
    start_daemon: Callable[..., Daemon],
) -> None:
    daemon = start_daemon(str(RIGS / "domains.py"), config=MIXED)
    patterns = [f"{slave}/*:0[1-4]" for slave in (0, 1, 4, 10, 33, 34, 39)]
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator, remote(daemon) as session:
        simulator.faults.drop(all_frames=True, count=0, probability=0.03)
        with session.trace(["0/*:0[1-4]"]) as other, Samples(daemon, patterns) as samples:
            wait_for(lambda: len(samples.seen) > ENOUGH, daemon)
            before: dict[int, tuple[Batch, int]] = {}
            with session.trace(patterns, before_s=600) as trace:
                for batch in trace:
                    assert not batch.lost
                    assert not before.keys() & {*batch.cycles}
                    before |= {cycle: (batch, at) for at, cycle in enumerate(batch.cycles)}
                    if batch.cycles[-1] > trace.live + ENOUGH:
                        break
            assert [*before] == sorted(before)
            assert next(iter(before)) == trace.begin < trace.live - ENOUGH
            history = {cycle: found for cycle, found in before.items() if cycle < trace.live}
            for batch in other:
                for at, cycle in enumerate(batch.cycles):
                    if cycle >= trace.begin:
                        mine, place = before[cycle]
                        for name in range(len(other.signals)):
                            assert mine.columns[name][place] == batch.columns[name][at]
                if batch.cycles[-1] >= trace.live + ENOUGH // 2:
                    break
    same, invalid = check(samples, history, trace, daemon)
    assert same > ENOUGH // 2
    assert invalid > 10


def test_outputs_and_inputs_in_pieces(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon(str(RIGS / "large.py"))
    patterns = ("1/*:01", "1/*:64", "3/*:01", "3/*:32", "4/*:01")
    assert compare(daemon, *patterns)[0] > ENOUGH // 2
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        simulator.faults.drop(every=1, count=0, probability=0.1, seed=7)
        simulator.faults.drop(every=1, count=0, probability=0.05, seed=8, way_back=True)
        assert compare(daemon, *patterns)[1] > 10


def test_both_sides_of_a_broken_ring(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    rig = tmp_path / "ring.toml"
    rig.write_text(RING)
    daemon = start_daemon(str(rig))
    assert compare(daemon, "*:0[1-4]") > (ENOUGH // 2, 0)
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        simulator.faults.break_link(2, 0)
        wait_for(lambda: "the ring is broken" in daemon.log, daemon)
        assert compare(daemon, "*:0[1-4]")[0] > ENOUGH // 2


def test_an_optional_slave_that_is_absent(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("line:3", config=OPTIONAL)
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        simulator.faults.power_off(2)
        wait_for(lambda: daemon.slave_rows("state")[2]["text"] != "OP", daemon)
        assert compare(daemon, "0/*", "1/*:0[1-4]", "2/*:0[1-4]")[0] > ENOUGH // 2


def test_what_cannot_be_traced(start_daemon: Callable[..., Daemon]) -> None:
    address = f"tcp/127.0.0.1:{free_port()}"
    daemon = start_daemon("line:160", config=f'[gateway]\nlisten = ["{address}"]\n')
    with daemon.client() as client:
        client.sample()
        signals = find_signals(client, [f"{slave}/*" for slave in range(20)])
    with remote(daemon) as session:
        for pattern, error, *told in (
            ("*", UsageError, "10000"),
            ("7/nosuch", StateError, "nosuch"),
            ("\n".join(["*"] * 101), UsageError, "101", "100"),
        ):
            for ask in (session.trace, lambda them: session.request(ReadHistory(them[0]))):
                with pytest.raises(error) as refused:
                    ask([pattern])
                names(refused.value, *told)
        every = [f"{signal.slave}/{signal.address}" for signal in signals]
        found = session.request(ReadHistory("\n".join(every)))["signals"]
        assert len(found) == len(every) > 1000  # names are no patterns: there may be many of them
        for slave in range(16):  # one after the other
            with session.trace([f"{slave}/*"]) as trace:
                next(iter(trace))
        with contextlib.ExitStack() as open_traces:
            for slave in range(8):
                open_traces.enter_context(session.trace([f"{slave}/*"]))
            open_traces.enter_context(session.trace(["0/*"]))  # one that is open already
            # The network has no place that is kept for this machine.
            with Remote(daemon.bus, address, timeout=60) as other:
                with pytest.raises(BusyError) as full:
                    other.trace(["8/*"])
                names(full.value, 8)
                assert other.request(ReadHistory("8/*"))["batch"]["cycles"]
            for slave in range(8, 12):
                open_traces.enter_context(session.trace([f"{slave}/*"]))
            with pytest.raises(BusyError) as full:
                session.trace(["12/*"])
            names(full.value, 12)
    assert daemon.stop() == 0
    daemon = start_daemon("line:1", config=f"{LOCAL}[flight_recorder]\nmemory_mb = 0\n")
    with remote(daemon) as session, pytest.raises(StateError) as none:
        session.trace(["*"])
    names(none.value, "flight_recorder.memory_mb", 0)


def test_history_begins_with_what_is_kept(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    """Half a megabyte of frames are some 2000 cycles."""
    config = f"cycle_time_us = 1000\n{LOCAL}[flight_recorder]\nmemory_mb = 1\n"
    daemon = start_daemon("line:1", config=config)
    with daemon.client() as client:
        client.wait(5000, timeout=PATIENCE)
    with remote(daemon) as session, session.trace(["0/*:01"], before_s=600) as trace:
        first = next(iter(trace))
        assert first.cycles[0] == trace.begin > 1000
        assert not first.lost
        whole = session.request(ReadHistory("0/*:01"))
        assert trace.begin <= whole["begin"] < trace.live + 2000
        old = session.request(ReadHistory("0/*:01", 1, 500))
        assert not old["batch"]["cycles"]
        assert not old["more"]
        assert old["begin"] == 500
    file = tmp_path / "run.csv"
    done = daemon.ctl_json("record", "0/*:01", "-o", str(file), "--before", "600", "--for", "0.1")
    assert 0.1 < done["before_s"] < 60
    # Cycles that the engine has missed are no cycles; there are few.
    missed = round(1000 * done["before_s"]) + 100 - done["left_out"] - done["cycles"]
    assert 0 <= missed < 100
    assert done["lost"] == 0
    again = ("-o", str(file), "--force", "--before", "600", "--for", "0.1")
    told = daemon.ctl("record", "0/*:01", *again)
    names(told.stdout, "600 s", "flight_recorder.memory_mb")


def test_a_gateway_that_stood_still_says_what_is_lost(
    start_daemon: Callable[..., Daemon],
) -> None:
    """Half a megabyte of frames are some 2000 cycles."""
    config = f"cycle_time_us = 1000\n{LOCAL}[flight_recorder]\nmemory_mb = 1\n"
    daemon = start_daemon("line:1", config=config)
    with remote(daemon) as session, session.trace(["0/*:01"]) as trace:
        batches = iter(trace)
        next(batches)
        for cycles, is_lost in ((500, False), (4000, True)):
            gateway = daemon.child_pid("ecatd.gateway")
            with daemon.client() as client:
                os.kill(gateway, signal.SIGSTOP)
                try:
                    client.wait(cycles, timeout=PATIENCE)
                    begin = client.cycle
                finally:
                    os.kill(gateway, signal.SIGCONT)
            lost = False
            for batch in batches:
                lost = lost or batch.lost
                if batch.cycles[0] > begin:
                    break
            assert lost == is_lost, cycles


def test_a_recording_from_another_machine_has_every_cycle(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    daemon = start_daemon("troll", config=f'[gateway]\nlisten = ["tcp/127.0.0.1:{free_port()}"]\n')
    address = re.search(r"tcp/[\d.:]+", daemon.config_file.read_text())
    assert address is not None
    file = tmp_path / "run.csv"
    done = daemon.ctl_json(
        *("--connect", address[0], "record", "4/*Value", "-o", str(file), "--for", "1")
    )
    with file.open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    numbers = [int(row["cycle"]) for row in rows]
    assert len(rows) == done["cycles"] == round(1e6 / CYCLE_TIME_US) - done["left_out"]
    assert done["lost"] == 0
    assert numbers == sorted(numbers)
