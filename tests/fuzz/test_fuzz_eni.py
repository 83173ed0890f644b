"""Mutated ENI files: made into configurations that can be read, or refused."""

import sys
import tomllib
from itertools import chain
from pathlib import Path

import pytest
from mutations import inputs, mutants, mutated_elements

sys.path.insert(0, str(Path(__file__).parents[1] / "unit"))

from eni_sample import MACHINE
from soe_samples import NETWORK

from ecatd.base.errors import ConfigError
from ecatd.config import read_config
from ecatd.config.writer import write_config
from ecatd.vendor.eni import convert, read_network

pytestmark = pytest.mark.long

FILES = inputs(1_500)
VALUES = ["0", "1", "-1", "254", "65535", "#xFFFFFFFF", "", "PS", "0003", "00" * 40, "Inputs"]


def test_r33_mutated_files_become_configurations_or_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.xml"
    accepted = refused = untidy = 0
    half = FILES // 2
    for data in chain(
        mutants([MACHINE.encode(), NETWORK.encode()], half, 1),
        mutated_elements(MACHINE, VALUES, half // 2, 1),
        mutated_elements(NETWORK, VALUES, half // 2, 2),
    ):
        path.write_bytes(data)
        try:
            network = read_network(path)
            found = convert(network, "ecat0")
        except ConfigError as error:
            refused += 1
            if not str(error).startswith(f"{path}:"):
                pytest.fail(str(error))
            continue
        accepted += 1
        untidy += bool(network.findings)
        read_config(tomllib.loads(write_config(found.config, found.bus, "1.0", found.notes)))
    assert refused + untidy > FILES / 4, "mutations must do harm"
    assert untidy > FILES / 20, "which is often left out"
    assert accepted > FILES / 10, "and not always"
