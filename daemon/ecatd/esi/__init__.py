"""ESI files: the XML that vendors give with a slave (ETG.2000).

```python
choice = choose(list_devices(path), path, type="EL1004", revision=0x00130000)
device = read_device(path, choice)
```

A file may hold hundreds of devices; only the chosen one is read completely. Modules for slots and
dictionaries in other files are not read; `EsiDevice.slots` and `dictionary_file` tell of them.

`reader` reads files, `dictionary` the object dictionaries in them, `xml` the XML below both;
`device` is what they make of it. The daemon itself reads no ESI files.
"""

from .device import EsiChoice, EsiDcMode, EsiDevice, EsiPdo, EsiSyncManager
from .dictionary import EsiEntry, EsiObject
from .reader import choose, list_devices, read_device

__all__ = [
    "EsiChoice",
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
