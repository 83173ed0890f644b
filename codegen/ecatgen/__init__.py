"""The generator: bus description to Modelica library.

```
bus description -> build -> ir -> render (templates) -> output (files)
```

- `origin`: what of the bus counts, and is kept beside the result
- `names`, `words`: identifiers from the names of slaves, PDOs and entries
- `connectors`, `blocks`: from entries and slaves to connectors and blocks; `drives`,
  `drive_units`: blocks of drives in SI units around them; `channels`: blocks with vectors
- `placement`, `labels`, `symbols`, `font`: how blocks look; `examples`, `diagram`: models of them
- `build`: all of it together, as the `ir`, which templates write down (`render`, `text`);
  `generate`: from the description to the folder
- `static_library`: the library EtherCAT; `output`: puts both into a folder; `differences`: and says
  what is another than before
- `fmu`: the same bus as an FMU
"""

from .generate import generate
from .output import Report

__all__ = ["Report", "generate"]
