"""The sizes of frames are the same for the engine, in C, and for what lies beside it, in Python."""

import re
import subprocess
from pathlib import Path

import pytest

from ecatd.etg import frame_sizes
from ecatd.master.engine import process_image as layout

pytestmark = pytest.mark.unprivileged

ROOT = Path(__file__).parents[2]


def test_both_languages_have_the_same_sizes(compiler: str, tmp_path: Path) -> None:
    header = (ROOT / "daemon/cyclic/engine.h").read_text()
    ours = {
        name: value
        for name, value in (vars(frame_sizes) | vars(layout)).items()
        if isinstance(value, int) and re.search(rf"^  {name} = ", header, re.MULTILINE)
    }
    assert len(ours) >= 12, ours
    lines = "".join(f'printf("%d\\n", {name});' for name in ours)
    source = tmp_path / "sizes.c"
    source.write_text(f'#include "engine.h"\n#include <stdio.h>\nint main(void) {{ {lines} }}\n')
    program = tmp_path / "sizes"
    folders = ("daemon/cyclic", "client_c/include", "client_c/src")
    subprocess.run(
        [compiler, *(f"-I{ROOT / folder}" for folder in folders), "-o", program, source], check=True
    )
    printed = subprocess.run([program], capture_output=True, text=True, check=True).stdout
    sizes = dict(zip(ours, map(int, printed.split()), strict=True))
    assert sizes == ours
