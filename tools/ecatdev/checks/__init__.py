"""Checks of a generated library that need no Modelica tool.

- `structure` checks files, names and texts.
- `conventions` checks names, descriptions and icons.
- `externals` compares external functions with the C header, with the help of the C compiler.
- `translation` reads the library with two independent Modelica front ends.

Each check yields one sentence per problem. Only `conventions` and `translation` need the front ends
(pymoca, rumoca).
"""

from .conventions import check_conventions
from .externals import check_externals
from .structure import check_structure
from .translation import check_syntax, check_translation

__all__ = [
    "check_conventions",
    "check_externals",
    "check_structure",
    "check_syntax",
    "check_translation",
]
