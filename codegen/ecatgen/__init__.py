"""The generator: bus description to Modelica library.

```
bus description -> build (blocks, examples) -> ir -> render (templates) -> output
```
"""

from .generate import generate
from .output import Report

__all__ = ["Report", "generate"]
