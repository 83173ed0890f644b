"""Transfers a file with SOEM, on a bus that does nothing else: `soem.py INTERFACE BYTES`.

Prints two times in seconds: of a read, and of a write.
"""

from __future__ import annotations

import sys
import time

import pysoem

from benchmarks.files.rig import NAME, SIZE

_PATIENCE_US = 5_000_000


def main(interface: str, size: int) -> None:
    """Reads the file, and writes its first bytes back."""
    master = pysoem.Master()
    master.open(interface)
    if master.config_init() < 1:
        raise SystemExit("SOEM finds no slave")
    for slave in master.slaves:
        slave.state = pysoem.PREOP_STATE
        slave.write_state()
    master.state_check(pysoem.PREOP_STATE, _PATIENCE_US)
    begin = time.monotonic()
    data = master.slaves[0].foe_read(NAME, 0, SIZE + 1_000_000, _PATIENCE_US)
    between = time.monotonic()
    written = master.slaves[0].foe_write("new.bin", 0, data[:size], _PATIENCE_US)
    end = time.monotonic()
    master.close()
    if len(data) != SIZE or written < 1:
        raise SystemExit("SOEM transfers another file")
    print(between - begin, end - between)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
