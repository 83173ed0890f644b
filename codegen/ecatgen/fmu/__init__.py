"""The plant as an FMU for co-simulation.

```
bus description -> build (variables) -> ir -> render (templates) -> archive
                                  binary, C sources -> files ---------^
```

The binary is the same for all buses: what the FMU has, it reads from `resources/plant.txt`. So
making one needs no compiler, and what runs is what was tested.
"""

from .generate import FmuReport, generate_fmu

__all__ = ["FmuReport", "generate_fmu"]
