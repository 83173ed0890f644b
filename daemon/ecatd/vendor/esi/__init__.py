"""ESI files: the XML that vendors give with a slave (ETG.2000).

```python
choice = choose(list_devices(path), path, type="EL1004", revision=0x00130000)
device = read_device(path, choice)
```

A file may describe hundreds of devices. Only the chosen one is read completely, with the modules
that its slots may have. `plug` puts modules into the slots. A dictionary in another file is not
read; `EsiDevice.dictionary_file` says whether a device has one.

Vendors' files are untidy. `Findings` takes what is wrong in them; what can be understood is used.

`reader` reads files, `dictionary` reads object dictionaries, and both use `xml`, with
`xml_text` for the encoding. `selection` finds the device that somebody means, also in folders.
`device` has the classes of the result. `modules` puts modules into slots, and `shift` moves the
indices that depend on the slot. `configure` adds the facts of a file to a configuration, and
`check` compares the PDOs of a configuration with a file. The daemon itself reads no ESI files.
"""

from .device import (
    EsiChoice,
    EsiCommand,
    EsiDcMode,
    EsiDevice,
    EsiModule,
    EsiPdo,
    EsiSlot,
    EsiSyncManager,
)
from .dictionary import EsiEntry, EsiObject
from .findings import Findings
from .modules import module_problems, plug
from .reader import list_devices, read_device
from .selection import (
    Described,
    Name,
    choose,
    devices_in,
    files_in,
    fitting,
    parse_code,
    parse_name,
)

__all__ = [
    "Described",
    "EsiChoice",
    "EsiCommand",
    "EsiDcMode",
    "EsiDevice",
    "EsiEntry",
    "EsiModule",
    "EsiObject",
    "EsiPdo",
    "EsiSlot",
    "EsiSyncManager",
    "Findings",
    "Name",
    "choose",
    "devices_in",
    "files_in",
    "fitting",
    "list_devices",
    "module_problems",
    "parse_code",
    "parse_name",
    "plug",
    "read_device",
]
