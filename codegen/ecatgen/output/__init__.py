"""Writes generated packages into a directory, all or nothing, and never loses a file of the user.

```
folder   reads the folder of a package, and the manifest, which lists the generated files in it
order    adds the classes of the user to package.order, after the generated classes
plan     decides which files are written, removed and kept, and finds files in the way
swap     builds the new folder beside the old one and then replaces the old one by it
failures turns errors of the file system into messages
report   reports the result
```
"""

from .folder import MANIFEST, Tree
from .install import install
from .report import Report

__all__ = ["MANIFEST", "Report", "Tree", "install"]
