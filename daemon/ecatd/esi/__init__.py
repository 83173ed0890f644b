"""ESI files: the XML that vendors give with a slave (ETG.2000).

```python
choice = choose(list_devices(path), path, type="EL1004", revision=0x00130000)
device = read_device(path, choice)
```

A file may describe hundreds of devices; only the chosen one is read completely. Modules for slots,
and dictionaries in other files, are not read; `EsiDevice.slots` and `dictionary_file` say whether
a device has them.

`reader` reads files, `dictionary` reads object dictionaries, and both use `xml`. `device` has the
classes of the result. `configure` adds to a configuration what a file knows, and `check` compares
the PDOs of a configuration with a file. The daemon itself reads no ESI files.
"""

from .device import EsiChoice, EsiCommand, EsiDcMode, EsiDevice, EsiPdo, EsiSyncManager
from .dictionary import EsiEntry, EsiObject
from .reader import choose, list_devices, read_device

__all__ = [
    "EsiChoice",
    "EsiCommand",
    "EsiDcMode",
    "EsiDevice",
    "EsiEntry",
    "EsiObject",
    "EsiPdo",
    "EsiSyncManager",
    "choose",
    "list_devices",
    "read_device",
]
