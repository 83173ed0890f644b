"""An importer for FMI-LS-BUS: it does with a bus simulation FMU what the standards say, no more.

Virtual ECUs are Python objects here. Steps end where a Tx_Clock ticks; in the event mode there, the
operations go to and fro.
"""

from __future__ import annotations

import ctypes
import math
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from fmpy import fmi3

import player

FORMAT_ERROR, TRANSMIT, TRANSMIT_FD, TRANSMIT_XL = 0x01, 0x10, 0x11, 0x12
CONFIRM, ARBITRATION_LOST, BUS_ERROR = 0x20, 0x30, 0x31
CONFIGURATION, STATUS, WAKEUP = 0x40, 0x41, 0x42
BAUD_RATE, ARBITRATION = 1, 4
BUFFER_AND_RETRANSMIT, DISCARD_AND_NOTIFY = 1, 2
ERROR_ACTIVE, ERROR_PASSIVE, BUS_OFF = 1, 2, 3
ACK_ERROR, PRIMARY, SECONDARY = 5, 1, 2
_EXTENDED, _REMOTE = 0x80000000, 0x40000000
TICK = 1e-9  # differences of time that count as none


def operation(code: int, arguments: bytes = b"") -> bytes:
    return struct.pack("<II", code, 8 + len(arguments)) + arguments


def transmit(
    identifier: int, data: bytes = b"", *, extended: bool = False, remote: bool = False
) -> bytes:
    head = struct.pack("<IBBH", identifier, extended, remote, len(data))
    return operation(TRANSMIT, head + data)


def baud_rate(bits_per_second: int) -> bytes:
    return operation(CONFIGURATION, struct.pack("<BI", BAUD_RATE, bits_per_second))


def arbitration(behavior: int) -> bytes:
    return operation(CONFIGURATION, bytes([ARBITRATION, behavior]))


def operations(data: bytes) -> list[tuple[int, bytes]]:
    """Code and arguments of each operation; their lengths must be right."""
    found = []
    while data:
        code, length = struct.unpack_from("<II", data)
        assert 8 <= length <= len(data), data
        found.append((code, data[8:length]))
        data = data[length:]
    return found


@dataclass
class Ecu:
    """A virtual ECU.

    Attributes:
        to_send: Operations that it sends at the next event.
        got: Code and arguments of each operation that it has got.
    """

    to_send: bytes = b""
    got: list[tuple[int, bytes]] = field(default_factory=list)

    def send(self, *items: bytes) -> None:
        self.to_send += b"".join(items)

    def frames(self) -> list[tuple[int, bytes]]:
        """Identifier and data of each frame that it has got."""
        return [
            (struct.unpack("<I", item[:4])[0], item[8:])
            for code, item in self.got
            if code == TRANSMIT
        ]

    def codes(self, code: int) -> list[bytes]:
        """The arguments of the operations with a code."""
        return [item for one, item in self.got if one == code]


class Importer(player.Player):
    """One instance of a bus simulation FMU, with virtual ECUs on all of its bus terminals."""

    def __init__(self, model: player.Model, **parameters: Any) -> None:
        super().__init__(model, event_mode=True)
        for name, value in parameters.items():
            self.set(name, value)
        names = sorted({name.partition(".")[0] for name in model.variables if ".Rx_Data" in name})
        self.ecus = [Ecu() for _ in names]
        self._references = [
            {
                end: model.variables[f"{name}.{end}"].valueReference
                for end in ("Rx_Clock", "Rx_Data", "Tx_Clock", "Tx_Data")
            }
            for name in names
        ]
        clock = model.variables[f"{names[0]}.Tx_Clock"]
        self._counts_down = clock.intervalVariability == "countdown"
        self._ticks = [math.inf for _ in names]
        self.empty_ticks = 0

    def start(self) -> None:
        super().start()
        self._event([])

    def _event(self, ticking: list[int]) -> None:
        """The event mode, in which the Tx_Clocks of some ECUs tick; it ends in the step mode."""
        delivered: dict[int, bytes] = {}
        if not self._counts_down:
            ticking = [number for number in range(len(self.ecus)) if self._ticks_itself(number)]
            assert not any(map(self._ticks_itself, range(len(self.ecus))))  # it says it once
        for number in ticking if self._counts_down else ():
            self.fmu.setClock([self._references[number]["Tx_Clock"]], [True])
        for number in ticking:
            (data,) = self.fmu.getBinary([self._references[number]["Tx_Data"]])
            (again,) = self.fmu.getBinary([self._references[number]["Tx_Data"]])
            assert again == data
            assert len(data) <= 2048
            delivered[number] = data
            self.empty_ticks += not data
        for number, ecu in enumerate(self.ecus):
            if ecu.to_send:
                self.fmu.setClock([self._references[number]["Rx_Clock"]], [True])
                self.fmu.setBinary([self._references[number]["Rx_Data"]], [ecu.to_send])
                ecu.to_send = b""
        assert not self.fmu.updateDiscreteStates()[0]
        for number, data in delivered.items():
            self.ecus[number].got += operations(data)
        if self._counts_down:
            self._ask_for_intervals()
        self.fmu.enterStepMode()

    def _ticks_itself(self, number: int) -> bool:
        (active,) = self.fmu.getClock([self._references[number]["Tx_Clock"]])
        return bool(active)

    def _ask_for_intervals(self) -> None:
        for number, references in enumerate(self._references):
            asked = (fmi3.fmi3ValueReference * 1)(references["Tx_Clock"])
            intervals, qualifiers = (ctypes.c_double * 1)(), (ctypes.c_int * 1)()
            self.fmu.getIntervalDecimal(asked, intervals, qualifiers)
            if qualifiers[0] == 2:  # changed
                self._ticks[number] = self.time + intervals[0]

    def advance(self, longest: float = 0.01) -> None:
        """A step to the next tick, or of the longest step that this importer makes."""
        end = min([self.time + longest, *self._ticks])
        needed = self.step(end - self.time)
        self.time = end
        sends = any(ecu.to_send for ecu in self.ecus)
        if not (self._counts_down or needed or sends):
            return
        ticking = [number for number, tick in enumerate(self._ticks) if tick <= end + TICK]
        self.fmu.enterEventMode()
        self._event(ticking)

    def until(self, condition: Callable[[], object], seconds: float = 30.0) -> None:
        """Goes on until a condition is met."""
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, (self.said, [ecu.got[-5:] for ecu in self.ecus])
            self.advance()
