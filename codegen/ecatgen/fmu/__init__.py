"""The plant as an FMU for co-simulation.

```
bus description -> build (variables) -> ir -> render (templates) -> archive
                                  binary, C sources -> files ---------^
```

The binary is the same for all buses: it reads the contents of the FMU from `resources/plant.txt`.
Making an FMU therefore needs no compiler, and every FMU contains the binary that was tested.
"""

from .generate import FmuReport, generate_fmu
from .ls_bus import LsBusReport, generate_ls_bus

__all__ = ["FmuReport", "LsBusReport", "generate_fmu", "generate_ls_bus"]
