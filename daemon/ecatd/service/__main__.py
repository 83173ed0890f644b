"""`python -m ecatd.service`, for a checkout that is not installed."""

import sys

from ecatd.commands import ecatd

sys.exit(ecatd())
