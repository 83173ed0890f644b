"""A time of day that jumps, for all processes that a test starts, and not for the test itself."""

import subprocess
from pathlib import Path

SOURCE = Path(__file__).with_suffix(".c")


class TimeOfDay:
    """The time of day of the processes that are started with `env`.

    Args:
        folder: Where the library for them is made, with gcc.

    Attributes:
        env: What is to be added to their environment.
        ahead: Seconds that their time of day is ahead of the real one.
    """

    def __init__(self, folder: Path) -> None:
        library, self._file = folder / "time_of_day.so", folder / "time_offset"
        self._file.write_bytes(bytes(8))
        command = ["gcc", "-std=c11", "-O1", "-Wall", "-Wextra", "-Werror", "-fPIC", "-shared"]
        subprocess.run([*command, str(SOURCE), "-o", str(library), "-ldl"], check=True)
        self.env = {"LD_PRELOAD": str(library), "ECAT_TIME_OFFSET": str(self._file)}
        self.ahead = 0

    def jump(self, seconds: int) -> None:
        """Sets it forward, or back."""
        self.ahead += seconds
        with self._file.open("r+b") as file:  # never shorter: the processes have it mapped
            file.write(self.ahead.to_bytes(8, "little", signed=True))
