"""The ring of the last frames: what is read while it is written is whole, and in order."""

import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_what_is_read_is_whole(compiler: str, tmp_path: Path) -> None:
    program = tmp_path / "frame_ring"
    folders = ("daemon/cyclic", "client_c/include", "client_c/src")
    subprocess.run(
        [
            *(compiler, "-Wall", "-Wextra", "-Werror", "-O2", "-g"),
            *("-fsanitize=address,undefined", "-fno-sanitize-recover=all"),
            *(f"-I{ROOT / folder}" for folder in folders),
            str(Path(__file__).with_name("frame_ring.c")),
            str(ROOT / "daemon" / "cyclic" / "frame_ring.c"),
            *("-o", str(program), "-lpthread", "-lm"),
        ],
        check=True,
    )
    result = subprocess.run([program], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    assert int(result.stdout.split()[0]) > 0
