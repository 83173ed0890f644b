"""What the configuration says about a bus. Nothing here talks to it."""

from .apply import Applied, apply
from .misfits import misfits
from .slaves import check_slaves

__all__ = ["Applied", "apply", "check_slaves", "misfits"]
