"""Device profiles: the meanings of the entries of known devices, from TOML files.

The profiles of ecatd are the `*.toml` files in this folder. Files of the machine and of the user
take precedence over them. `docs/device-profiles.md` describes the format. Only
`ecatd.config.meanings` puts the meanings into the bus description.
"""

from .file import load_profiles
from .profile import DeviceProfile, Meaning, Profiles

__all__ = ["DeviceProfile", "Meaning", "Profiles", "load_profiles"]
