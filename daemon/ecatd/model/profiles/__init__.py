"""Device profiles: what the entries of known devices mean, from TOML files.

Ours are the `*.toml` files beside this module; a machine and a user have files of their own, which
count first. `docs/device-profiles.md` describes the format. `ecatd.model.meanings` puts the
profiles into the bus description, and is the only one who does.
"""

from .file import load_profiles
from .profile import DeviceProfile, Meaning, Profiles

__all__ = ["DeviceProfile", "Meaning", "Profiles", "load_profiles"]
