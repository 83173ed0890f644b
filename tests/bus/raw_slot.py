"""A client that does not keep to the library: it writes into its slot whatever it likes.

Run with the name of a bus, it puts random requests into its slot, and rings, without end.
"""

import mmap
import os
import random
import sys
from pathlib import Path
from typing import Any

from ecatd.client import Client
from ecatd.shm import contract as shm
from ecatd.shm.files import folders


class RawSlot:
    """The slot of a client, of this process by default, mapped.

    Args:
        bus: Name of the bus.
        pid: Process of the client.

    Attributes:
        bell: Its `ecat_out_doorbell`, in place.
        requests: Its `ecat_out_request`s, in place.
    """

    def __init__(self, bus: str, pid: int | None = None) -> None:
        pid = pid or os.getpid()
        file = os.open(folders()[0] / f"{bus}.out", os.O_RDWR)
        self.memory = mmap.mmap(file, 0)
        os.close(file)
        self.header = shm.struct("ecat_out_header").from_buffer(self.memory)
        bell, slot = shm.struct("ecat_out_doorbell"), shm.struct("ecat_out_slot")
        for number in range(self.header.slot_count):
            self.at = self.header.slots_offset + number * self.header.slot_stride
            self.bell: Any = bell.from_buffer(
                self.memory, self.header.doorbells_offset + number * shm.size("ecat_out_doorbell")
            )
            if self.bell.generation and slot.from_buffer(self.memory, self.at).pid == pid:
                break
        else:
            raise LookupError(f"process {pid} has no slot")
        self.number = number
        kind = shm.struct("ecat_out_request") * shm.REQUESTS
        self.requests: Any = kind.from_buffer(self.memory, self.at + shm.size("ecat_out_slot"))

    def committed(self) -> Any:
        """The header of what was committed last, an `ecat_out_image`."""
        at = self.bell.commit_seq % shm.IMAGES * self.header.image_stride
        return shm.struct("ecat_out_image").from_buffer_copy(
            self.memory, self.at + self.header.images_offset + at
        )

    def commit_again(self, byte: int, value: bytes) -> None:
        """Commits what was committed last, with other bytes at `byte` of its values."""
        header = shm.struct("ecat_out_image")
        seq = self.bell.commit_seq
        first = self.at + self.header.images_offset
        old, new = (first + n % shm.IMAGES * self.header.image_stride for n in (seq, seq + 1))
        size = self.header.image_stride
        self.memory[new : new + size] = self.memory[old : old + size]
        image = header.from_buffer(self.memory, new)
        image.seq = seq + 1
        at = new + shm.size("ecat_out_image") + image.bytes + byte - image.first
        self.memory[at : at + len(value)] = value
        self.bell.commit_seq = seq + 1

    def commit_nonsense(self) -> None:
        """Commits a part of the output image that is not the one of the client's outputs."""
        seq = self.bell.commit_seq + 1
        at = self.at + self.header.images_offset + seq % shm.IMAGES * self.header.image_stride
        image = shm.struct("ecat_out_image").from_buffer(self.memory, at)
        image.seq, image.first, image.bytes = seq, 1 << 20, 8
        image.generation = self.bell.generation
        self.bell.commit_seq = seq


def main() -> None:
    source = random.Random(1)
    with Client(sys.argv[1]) as client:
        client.sdo_upload(0, 0x1018, 1)  # takes a slot
        raw = RawSlot(sys.argv[1])
        print(Path("/proc/self/comm").read_text().strip(), flush=True)
        while True:
            request = source.choice(raw.requests)
            request.op = source.randrange(6)
            request.slave = source.randrange(20)
            request.index = source.randrange(0x1000)  # there are no objects
            request.complete = source.choice((0, 1, 255))
            request.length = source.choice((0, 1, 4, 512, 513, 1 << 31))
            request.data = b"M" + source.randbytes(8)  # M is no AL state
            request.seq = (
                raw.bell.request_seq + source.choice((-1, 0, 1, 1, 1, 1 << 20)) & (1 << 32) - 1
            )
            raw.bell.request_seq = raw.bell.request_seq + 1 & (1 << 32) - 1


if __name__ == "__main__":
    main()
