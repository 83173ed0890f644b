"""Runs in the machine: has the drive turn, and goes on until it is killed."""

import struct
import sys

from ecatd import Client
from ecatd.base.errors import EcatError

DRIVE, SPEED = 0, 200_000


def main() -> None:
    with Client("ecat0") as client:
        # Quick stop follows a ramp, which takes a second from this speed.
        client.sdo_download(DRIVE, 0x6085, 0, struct.pack("<I", SPEED)).result()
        client.claim(DRIVE, lease=20.0)

        def get(index: int) -> int:
            return int(client.signal(DRIVE, index).raw)

        def put(index: int, value: int) -> None:
            client.signal(DRIVE, index).raw = value

        put(0x6060, 9)
        put(0x60FF, SPEED)
        put(0x6072, 1000)
        while True:
            client.wait(1, timeout=60)
            client.sample()
            state = get(0x6041) & 0x6F
            put(0x6040, {0x21: 7, 0x23: 15, 0x27: 15}.get(state, 6))
            client.commit()


try:
    main()
except EcatError as error:
    sys.exit(f"spin: {error}")
