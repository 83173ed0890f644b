"""Mutated ESI files: made into devices, or refused with the documented error."""

import sys
from itertools import chain
from pathlib import Path

import pytest
from mutations import inputs, mutants, mutated_elements

sys.path.insert(0, str(Path(__file__).parents[1] / "unit"))

from esi_sample import SAMPLE

from ecatd.model.errors import ConfigError
from ecatsim.esc import Segment
from ecatsim.files.esi import device_from_esi

pytestmark = pytest.mark.long


FILES, SHARDS = inputs(2_000), 2
VALUES = ["0", "1", "-1", "255", "65536", "#xFFFFFFFF", "#x", "", "UINT", "STRING(65535)", "DT2000"]
VALUES += ["ARRAY [0..99999] OF BYTE", "DT2001ARR", "RW", "1e999", "nan", "\u2603", "00" * 300]


@pytest.mark.parametrize("shard", range(SHARDS))
def test_r33_mutated_files_become_devices_or_are_refused(shard: int, tmp_path: Path) -> None:
    path = tmp_path / "x.xml"
    count = FILES // SHARDS // 2
    accepted = refused = 0
    for data in chain(
        mutants([SAMPLE.encode()], count, shard),
        mutated_elements(SAMPLE, VALUES, count, shard),
    ):
        path.write_bytes(data)
        segment = Segment()
        try:
            device_from_esi(path, "AX2", revision=0x00020001).attach(segment, 0, 0)
            accepted += 1
        except ConfigError as error:
            refused += 1
            message = str(error)
            if not message.startswith(f"{path}:"):
                pytest.fail(message)
        finally:
            segment.close()
    assert refused > count / 4, "mutations must do harm"
    assert accepted > count / 4, "and not always"
