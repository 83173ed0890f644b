"""Checks of a generated library that need no Modelica tool.

`structure` looks at files and texts, `conventions` at names and descriptions, `externals` has the C
compiler compare declarations with the header, `translation` has two independent Modelica front ends
read the library. Each check yields one sentence per problem. The front ends (pymoca, rumoca) are
needed for `conventions` and `translation` only.
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
