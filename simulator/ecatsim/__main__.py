"""`python -m ecatsim`."""

import sys

from .cli import main

sys.exit(main())
