"""`python -m ecatsim`."""

import sys

from .cli.main import main

sys.exit(main())
