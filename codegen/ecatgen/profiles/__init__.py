"""What values of known devices mean: units, scales, enumerations; from the TOML files beside this.

Format of the files: `docs/device-profiles.md`. Users add files of their own, which win over ours.
"""

from .file import load_profiles, read_profiles, user_devices
from .profile import Meaning, Profiles, Value
from .write import profiles_file

__all__ = [
    "Meaning",
    "Profiles",
    "Value",
    "load_profiles",
    "profiles_file",
    "read_profiles",
    "user_devices",
]
