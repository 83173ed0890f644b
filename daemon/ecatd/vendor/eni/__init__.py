"""ENI files: the configuration of a network for an EtherCAT master (ETG.2100).

```python
network = read_network(path)
found = convert(network, "ecat0")
text = write_config(found.config, found.bus, VERSION, found.notes)
```

`reader` reads a file into the classes of `network`. `convert` makes a configuration of them, with
`process_data` for the PDOs and `registers` for the register commands. `report` lists what the
configuration has of each part of the file. The daemon itself reads no ENI files.
"""

from .convert import Converted, convert
from .network import EniNetwork
from .reader import read_network
from .report import Remark, Report

__all__ = ["Converted", "EniNetwork", "Remark", "Report", "convert", "read_network"]
