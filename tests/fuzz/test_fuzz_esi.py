"""Mutated ESI files: made into devices, or refused with the documented error."""

import re
import sys
from itertools import chain
from pathlib import Path

import pytest
from mutations import inputs, mutants, mutated_elements

sys.path.insert(0, str(Path(__file__).parents[1] / "unit"))

from esi_sample import SAMPLE
from soe_samples import SHAPES as SOE_SHAPES
from vendor_shapes import ENCODINGS, SHAPES, esi

from ecatd.base.errors import ConfigError
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
    accepted = refused = untidy = 0
    for data in chain(
        mutants([SAMPLE.encode()], count, shard),
        mutated_elements(SAMPLE, VALUES, count, shard),
    ):
        path.write_bytes(data)
        segment = Segment()
        try:
            device = device_from_esi(path, "AX2", revision=0x00020001)
            device.attach(segment, 0, 0)
            accepted += 1
            untidy += bool(device.remarks)
            assert all(text.startswith(f"{path}:") for text in device.remarks)
        except ConfigError as error:
            refused += 1
            message = str(error)
            if not message.startswith(f"{path}:"):
                pytest.fail(message)
        finally:
            segment.close()
    assert refused + untidy > count / 4, "mutations must do harm"
    assert untidy > count / 20, "which is often left out"
    assert accepted > count / 4, "and not always"


@pytest.mark.parametrize("shard", range(SHARDS))
def test_r33_mutated_files_of_vendors_do(shard: int, tmp_path: Path) -> None:
    """The shapes of vendors' files, mutated, mixed with each other, and in other encodings."""
    path = tmp_path / "x.xml"
    texts = [shape.text for shape in SHAPES.values()]
    texts += [esi(encoding=encoding, name=name) for encoding, name in ENCODINGS.items()]
    count = FILES // SHARDS // 2
    each = max(1, count // len(texts))
    accepted = 0
    for data in chain(
        mutants([*map(encoded, texts)], count, shard),
        *(mutated_elements(text, VALUES, each, shard) for text in texts),
    ):
        path.write_bytes(data)
        for strict in (False, True):
            segment = Segment()
            try:
                device = device_from_esi(path, "Shape", strict=strict)
                device.attach(segment, 0, 0)
                accepted += 1
                assert not (strict and device.remarks)
            except ConfigError as error:
                if not str(error).startswith(f"{path}:"):
                    pytest.fail(str(error))
            finally:
                segment.close()
    assert accepted > count / 4


def encoded(text: str) -> bytes:
    """A file in the encoding that it declares, as far as that has its letters."""
    match = re.search('encoding="([^"]*)"', text)
    return text.encode(match[1] if match else "utf-8", "replace")


def test_r33_mutated_files_of_soe_drives_become_devices_or_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.xml"
    values = [*VALUES, "16", "24", "#x1018", "0700", "020002003300", "PS"]
    accepted = 0
    for number, shape in enumerate(SOE_SHAPES.values()):
        for data in chain(
            mutants([shape.encode()], FILES // 20, number),
            mutated_elements(shape, values, FILES // 20, number),
        ):
            path.write_bytes(data)
            segment = Segment()
            try:
                device_from_esi(path).attach(segment, 0, 0)
                accepted += 1
            except ConfigError as error:
                if not str(error).startswith(f"{path}:"):
                    pytest.fail(str(error))
            finally:
                segment.close()
    assert accepted > FILES / 20
