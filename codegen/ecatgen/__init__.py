"""The generator: bus description to Modelica library.

```
bus description -> build -> ir -> render (templates) -> output (files)
```

- `origin`: the part of a bus description that a library or FMU is made from and contains
- `names`, `words`: Modelica identifiers from the names of slaves, PDOs and entries
- `connectors`, `blocks`: a connector for each entry and a block for each slave; `drives`,
  `drive_units`: blocks in SI units around those of drives; `channels`: blocks with vectors
- `can`: messages of CAN buses behind terminals, from DBC and EDS files; `can_blocks`: their signals
  as connectors
- `placement`, `labels`, `symbols`, `font`: the layout of icons and diagrams; `examples`, `diagram`:
  example models
- `build`: puts all parts together in the `ir`, from which templates write files (`render`), which
  hold only what `text` has made for their language (`environment`); `generate`: goes all the way
  from the bus description to the folder
- `static_library`: the library EtherCAT; `output`: writes both libraries into a folder;
  `differences`: the changes since an earlier run
- `recorded`: recorded values of the bus as a block
- `fmu`: the same bus as an FMU; `c_structs`: its process image as structs for C
"""

from .generate import generate
from .output import Report

__all__ = ["Report", "generate"]
