"""The watch over other masters, on interfaces that come and go."""

from __future__ import annotations

import socket
import time

import pytest
from inside import delete
from test_simulator_topology import FIRST, run

from ecatd.base.errors import UnreachableError
from ecatd.server.watch.foreign_masters import ForeignWatch
from ecatsim.net import netlink

pytestmark = pytest.mark.bus

PEER = "peer"
STRANGER = "ffffffffffff 020000000001 88a4 0e10 07 05 00003001 0200 0000" + 36 * "00"


def watch_an_interface_that_comes_for_a_moment() -> list[int]:
    watch = ForeignWatch([FIRST], 1)
    delete(FIRST)
    with pytest.raises(UnreachableError):
        watch.reopen(0)
    found = [watch.look(0).count]
    netlink.create_veth(FIRST, PEER)
    watch.reopen(0)
    raw = socket.socket(socket.AF_PACKET, socket.SOCK_RAW)
    raw.bind((PEER, 0x88A4))
    raw.send(bytes.fromhex(STRANGER))
    for _ in range(1000):
        if found[-1]:
            break
        time.sleep(0.01)
        found[1:] = [watch.look(0).count]
    watch.close()
    return found


def test_an_interface_that_is_gone_again_when_it_is_opened() -> None:
    assert run("troll", watch_an_interface_that_comes_for_a_moment) == [0, 1]
