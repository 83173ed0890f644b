"""Statistics of a bus, read from its shared memory without a request to the daemon.

```python
first = read("ecat0")
time.sleep(1)
last_second = read("ecat0") - first
print(last_second.counters["lost"], last_second.times["exchange"].quantile(0.99) / 1000, "µs")
```

The engine always counts in the shared memory, so reading has no effect on it.
"""

from .maps import from_map, to_map
from .reader import read
from .snapshot import Bin, CanChannel, Clock, Domain, Grant, Histogram, LongCycle, Snapshot

__all__ = [
    "Bin",
    "CanChannel",
    "Clock",
    "Domain",
    "Grant",
    "Histogram",
    "LongCycle",
    "Snapshot",
    "from_map",
    "read",
    "to_map",
]
