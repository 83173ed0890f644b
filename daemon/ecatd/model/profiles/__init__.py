"""Device profiles: what the entries of known devices mean, from TOML files.

Ours are the `*.toml` files beside this module. Files of the machine and of the user take precedence
over them. `docs/device-profiles.md` describes the format. Only `ecatd.model.meanings` puts the
meanings into the bus description.
"""

from .file import load_profiles
from .profile import DeviceProfile, Meaning, Profiles

__all__ = ["DeviceProfile", "Meaning", "Profiles", "load_profiles"]
