"""Writes generated packages into a directory, all or nothing, and never loses a file of the user.

```
folder   what is in the folder of a package now, and which of it is ours (the manifest)
order    package.order with the classes of the user behind the generated ones
plan     what is written, removed and kept; what stands in the way
swap     the new folder is made beside the old one, and then takes its place
failures what is said where that cannot be done
report   what was done
```
"""

from .folder import MANIFEST, Tree
from .install import install
from .report import Report

__all__ = ["MANIFEST", "Report", "Tree", "install"]
