"""Mutated captures: read as far as they can be understood, and made into a rig or refused."""

import json
import random
import sys
import tomllib
from itertools import chain
from pathlib import Path

import pytest
from mutations import inputs, mutants

sys.path.insert(0, str(Path(__file__).parents[1] / "unit"))

from pcap_sample import cooked, over_udp, pcap, pcapng, pcapng_big, sample, tagged

from ecatd.base.errors import ConfigError, StateError
from ecatd.base.pcapng import Frame
from ecatsim.files.rig_writer import rig_text
from ecatsim.pcap.report import document, lines, read_capture
from ecatsim.pcap.rig import captured_slaves

pytestmark = pytest.mark.long

FILES = inputs(120)
KEPT = 400
"""Frames of the sample that are mutated: those of the start are the most interesting."""


def read(path: Path) -> bool:
    """Reads a capture; returns whether it becomes a rig."""
    capture = read_capture(path)
    json.dumps(document(capture))
    assert all(line.isprintable() or not line for line in lines(capture))
    try:
        slaves = captured_slaves(capture.segment)
    except StateError:
        return False
    tomllib.loads(rig_text("x", slaves))
    return True


def test_mutated_files_are_read_or_refused(tmp_path: Path) -> None:
    frames = sample()[0][:KEPT]
    seeds = [
        *(pcapng(frames), pcapng_big(frames), pcap(frames), pcap(frames, ">")),
        *(pcap(frames, cover=cover) for cover in (tagged, over_udp)),
        pcap(frames, link=113, cover=cooked),
    ]
    path = tmp_path / "x"
    rigs = refused = 0
    heads = [seed[:64] for seed in seeds]  # in a whole file they are hardly ever hit
    for data in chain(mutants(seeds, FILES, 1), mutants(heads, FILES // 4, 2)):
        path.write_bytes(data)
        try:
            rigs += read(path)
        except ConfigError as error:
            refused += 1
            if not str(error).startswith(f"{path}:"):
                pytest.fail(str(error))
    assert refused
    assert rigs > FILES / 10


def test_mutated_frames_are_read(tmp_path: Path) -> None:
    """Every frame is whole for the file, and nonsense within."""
    frames, dice, path = sample()[0], random.Random(2), tmp_path / "x"
    rigs = 0
    for _ in range(FILES // 2):
        changed = []
        for frame in frames:
            data = bytearray(frame.data)
            for _ in range(dice.choice((0, 0, 0, 1, 3))):
                data[dice.randrange(len(data))] = dice.choice((0, 1, 0x7F, 0x80, 0xFF))
            if dice.random() < 0.02:
                del data[dice.randrange(len(data)) :]
            if dice.random() < 0.98:
                changed.append(Frame(frame.time_ns, 0, frame.sent, bytes(data)))
        if dice.random() < 0.1:
            dice.shuffle(changed)
        path.write_bytes(pcapng(changed))
        rigs += read(path)
    assert rigs
