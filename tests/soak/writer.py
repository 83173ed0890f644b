"""Owns the outputs of a slave, counts in them, and checks what comes back: `writer.py BUS SLAVE`.

The slave returns its outputs as inputs. What comes back must be a number that this process has
committed, and never an older one than before: else an output was lost, doubled, or another's.
"""

import random
import sys
import time
from contextlib import suppress

from ecatd import Client
from ecatd.base.errors import LeaseError, OwnedError, StateError, UnreachableError
from ecatd.shm.contract import WkcState

BYTES = range(1, 5)
PATIENCE_S = 60.0
"""For what must arrive some time while the slave takes part."""


def count(bus: str, slave: int) -> None:
    """Goes on until it is killed.

    Raises:
        AssertionError: Something came back that must not.
    """
    with Client(bus) as client:
        outputs = [client.signal(slave, 0x7000, byte) for byte in BYTES]
        inputs = [client.signal(slave, 0x6000, byte) for byte in BYTES]
        name = random.randrange(1, 256)  # in the last byte
        committed = seen = 0
        claimed = arrived = False
        since = time.monotonic()
        while True:
            client.wait(1, timeout=60)
            client.sample()
            info = client.slaves()[slave]
            if not claimed:
                with suppress(OwnedError, StateError):
                    client.claim(slave, lease=0.5)
                    claimed = True
                    seen = 0
            if client.domain(info.domain).wkc_state == WkcState.COMPLETE and info.al_state == 8:
                data = bytes(int(entry.raw) for entry in inputs)
                back = int.from_bytes(data[:3], "little")
                if data[3] != name:
                    # Zero is the safe value: nobody owned it for a moment, or the slave has begun
                    # anew. Before the first own value, there may be that of another owner.
                    assert not any(data) or not arrived, (slave, data, committed)
                    back = 0
                else:
                    assert seen <= back <= committed, (slave, seen, back, committed)
                    arrived = True
                if back != seen or back == committed:
                    since = time.monotonic()
                seen = back
                assert time.monotonic() - since < PATIENCE_S, (slave, seen, committed, "lost")
            else:
                since = time.monotonic()
                seen = 0
            if claimed:
                committed += 1
                data = committed.to_bytes(3, "little") + bytes([name])
                for entry, value in zip(outputs, data, strict=True):
                    entry.raw = value
                try:
                    client.commit()
                except LeaseError:
                    claimed = False


if __name__ == "__main__":
    try:
        count(sys.argv[1], int(sys.argv[2]))
    except UnreachableError:
        sys.exit(0)
