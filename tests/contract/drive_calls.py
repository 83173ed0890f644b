"""The C calls of EtherCAT.Drives.CiA402 from Python, and the simulator's record of the motors."""

import ctypes
import itertools
import subprocess
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from enum import IntEnum, IntFlag
from pathlib import Path
from typing import Any

SOURCE = Path(__file__).with_name("drive_calls.c")
RIG = Path(__file__).parents[1] / "rigs" / "drives.py"
ELMO, GENERIC = 0, 1
"""Positions of its drives."""
TURN = 65536
"""Increments of the Elmo Gold for a revolution."""


class Mode(IntEnum):
    """Object 0x6060."""

    PROFILE_POSITION = 1
    PROFILE_VELOCITY = 3
    PROFILE_TORQUE = 4
    CYCLIC_POSITION = 8
    CYCLIC_VELOCITY = 9
    CYCLIC_TORQUE = 10


class State(IntEnum):
    """EtherCAT.Types.DriveState."""

    NOT_READY_TO_SWITCH_ON = 1
    SWITCH_ON_DISABLED = 2
    READY_TO_SWITCH_ON = 3
    SWITCHED_ON = 4
    OPERATION_ENABLED = 5
    QUICK_STOP_ACTIVE = 6
    FAULT_REACTION_ACTIVE = 7
    FAULT = 8


RELATIVE, ABSOLUTE = 1, 2
AUTOMATIC, NEEDS_EDGE = 1, 2  # EtherCAT.Types.DriveRestart
WAIT, CONTINUE = 2, 3  # whenFailed of the EtherCATMaster


class Has(IntFlag):
    """What is mapped."""

    MODE_DISPLAY = 1
    POSITION = 2
    VELOCITY = 4
    TORQUE = 8
    CURRENT = 16


class Settings(ctypes.Structure):
    """`ecatm_drive_settings`."""

    _fields_ = (
        ("mode", ctypes.c_int),
        ("reference", ctypes.c_int),
        ("restart", ctypes.c_int),
        ("axis", ctypes.c_int),
        ("entries", ctypes.c_int),
        ("homing_method", ctypes.c_int),
        ("mode_object", ctypes.c_int),
        ("encoder", ctypes.c_double),
        ("gear", ctypes.c_double),
        ("velocity_scale", ctypes.c_double),
        ("rated_torque", ctypes.c_double),
        ("rated_current", ctypes.c_double),
        ("max_torque", ctypes.c_double),
        ("approach_speed", ctypes.c_double),
        ("standstill_speed", ctypes.c_double),
        ("max_dropout", ctypes.c_double),
    )


def settings(mode: Mode, **values: float) -> Settings:
    """Settings for the Elmo Gold of the rig, and what differs."""
    result = Settings(
        mode=mode,
        reference=RELATIVE,
        restart=NEEDS_EDGE,
        axis=1,
        entries=31,
        mode_object=0,
        encoder=65536,
        gear=1,
        velocity_scale=65536,
        rated_torque=0.4,
        rated_current=5,
        max_torque=0.8,
        approach_speed=10,
        standstill_speed=0.5,
        max_dropout=30,  # a busy machine loses frames
    )
    for name, value in values.items():
        setattr(result, name, value)
    return result


class Axis(ctypes.Structure):
    """`axis` of drive_calls.c."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("master", "domain", "slave", "drive")),
        ("outputs", ctypes.c_void_p * 6),
        ("inputs", ctypes.c_void_p * 6),
        ("cycle", ctypes.c_int),
        ("raw", ctypes.c_int * 6),
        ("state", ctypes.c_int),
        ("enabled", ctypes.c_int),
        ("command", ctypes.c_int * 6),
        ("start_up", ctypes.c_int),
        ("homing", ctypes.c_int),
        ("reached", ctypes.c_int),
        *((name, ctypes.c_double) for name in ("phi", "w", "tau", "i")),
    )


def build(out: Path, compiler: str, folder: Path) -> ctypes.CDLL:
    """Compiles the calls against a generated library."""
    resources = out / "EtherCAT" / "Resources"
    (archive,) = (resources / "Library").rglob("libecat.a")
    file = folder / "drive_calls.so"
    subprocess.run(
        [
            *(compiler, "-Wall", "-Wextra", "-Werror", "-O1", "-fPIC", "-shared"),
            f"-I{resources / 'Include'}",
            f"-I{resources / 'Source' / 'standalone'}",
            *(str(SOURCE), str(archive), "-lm", "-o", str(file)),
        ],
        check=True,
    )
    calls = ctypes.CDLL(str(file))
    calls.axis_open.restype = ctypes.POINTER(Axis)
    calls.logic_open.restype = ctypes.c_void_p
    return calls


def records(file: Path, slave: int, start: int) -> list[dict[str, float]]:
    """The rows of the simulator's record (tests/rigs/drives.py) about one of its drives.

    Args:
        file: The record.
        slave: Position of the drive.
        start: Where to begin, in bytes.
    """
    with file.open() as lines:
        columns = lines.readline().strip().split(",")
        lines.seek(max(start, lines.tell()))
        rows = [line.strip().split(",") for line in lines if line.endswith("\n")]
    return [
        dict(zip(columns, map(float, row), strict=True)) for row in rows if int(row[0]) == slave
    ]


class Player:
    """Plays samples of 1 ms with a drive.

    Attributes:
        a: What the last sample has read and written.
        inputs: What the block is given: enable, quick_stop, fault_reset, home, valid.
        reference: The reference, a function of the time.
        twice: Whether each sample is evaluated twice, with wrong inputs at first.
        history: (time, state, enabled, control word, target position, position, start-up list) of
            all samples.
    """

    def __init__(
        self,
        calls: ctypes.CDLL,
        bus: str,
        slave: int,
        drive: Settings,
        start_up: Sequence[tuple[int, int, int, int]] = (),
        failure: int = WAIT,
        lease: float = 30.0,
    ) -> None:
        vendor, product = ((0x9A, 0x30924), (0xFFFF, 0x402))[slave]
        self._calls = calls
        table = (ctypes.c_int * (4 * len(start_up)))(*itertools.chain(*start_up))
        self._axis = calls.axis_open(
            bus.encode(),
            ctypes.c_double(0.001),
            ctypes.c_double(lease),
            failure,
            slave,
            vendor,
            product,
            ctypes.byref(drive),
            table,
            len(start_up),
        )
        self.a: Any = self._axis.contents
        self.time = 0.0
        self.inputs = {"enable": 0, "quick_stop": 0, "fault_reset": 0, "home": 0, "valid": 1}
        self.reference: Callable[[float], float] = lambda time: 0.0
        self.twice = False
        self.history: list[tuple[float, int, int, int, int, int, int]] = []

    def __enter__(self) -> "Player":
        return self

    def __exit__(self, *_: object) -> None:
        self._calls.axis_close(self._axis)

    def set(self, **values: bool) -> None:
        """Changes inputs."""
        self.inputs.update({name: int(value) for name, value in values.items()})

    def step(self) -> None:
        """One sample."""
        if self.twice:
            self._evaluate(valid=1, enable=0, quick_stop=0, fault_reset=1, home=0, reference=1e6)
        self._evaluate(**self.inputs, reference=self.reference(self.time))
        a = self.a
        self.history.append(
            (self.time, a.state, a.enabled, a.command[0], a.command[2], a.raw[2], a.start_up)
        )
        self.time += 0.001

    def _evaluate(
        self,
        *,
        valid: int,
        enable: int,
        quick_stop: int,
        fault_reset: int,
        home: int,
        reference: float,
    ) -> None:
        time = ctypes.c_double(self.time)
        self._calls.axis_measure(self._axis, time, valid)
        self._calls.axis_command(
            *(self._axis, time, enable, quick_stop, fault_reset, home),
            ctypes.c_double(reference),
        )

    def run(self, seconds: float) -> None:
        """As many samples as seconds have."""
        for _ in range(round(seconds / 0.001)):
            self.step()

    def until(self, condition: Callable[[], bool], seconds: float = 120) -> None:
        """Samples until something is so."""
        end = self.time + seconds
        while not condition():
            assert self.time < end, f"state {State(self.a.state).name}, {list(self.a.command)}"
            self.step()

    def enable(self) -> None:
        """Enables the drive, and waits until it is."""
        self.set(enable=True)
        self.until(lambda: self.a.enabled)

    def disable(self) -> None:
        """Disables the drive, and waits until its motor rests."""
        self.set(enable=False)
        self.until(lambda: self.a.state == State.READY_TO_SWITCH_ON and abs(self.a.w) < 1e-3)


Play = Callable[..., Player]
Record = Callable[[int], list[dict[str, float]]]


def generic(mode: Mode, **values: float) -> Settings:
    """Settings for the generic drive, which maps no current and no maximum torque."""
    entries = Has.MODE_DISPLAY | Has.POSITION | Has.VELOCITY | Has.TORQUE
    return settings(
        mode, **{"entries": entries, "encoder": 10_000, "velocity_scale": 10_000} | values
    )


def turn_away(player: Player, speed: float = 20.0) -> None:
    """Moves the motor by some revolutions in velocity mode, and lets it rest."""
    player.reference = lambda time: speed
    player.enable()
    player.run(1)
    player.disable()


def commanded(row: dict[str, float]) -> bool:
    """Whether the outputs belong to somebody: at their safe values all are 0."""
    return row["control"] != 0


def in_operation(row: dict[str, float]) -> bool:
    return int(row["status"]) & 0x6F == 0x27


def in_the_meantime(player: Player, work: Callable[[], object]) -> None:
    """Plays on until some work is done."""
    with ThreadPoolExecutor(1) as pool:
        done = pool.submit(work)
        while not done.done():
            player.step()
        done.result()
