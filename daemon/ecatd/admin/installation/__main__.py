"""Writes the files of the service for a package: `python -m ecatd.admin.installation FOLDER`."""

import sys
from pathlib import Path

from .places import DISTRIBUTION, files

if __name__ == "__main__":
    for path, data in files(DISTRIBUTION, Path("/usr/bin/ecatd")).items():
        file = Path(sys.argv[1]) / path.relative_to("/")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data)
