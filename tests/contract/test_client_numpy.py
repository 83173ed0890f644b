"""The last sample of a domain as an array of numpy."""

import gc
import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pytest
from test_client_objects import SHAPES, image_bytes, make_bus
from test_return import serve
from test_shared_memory import put_image

from conftest import naming
from ecatd.base.errors import UsageError
from ecatd.client import Client
from ecatd.master.engine.shared_memory import SharedMemory


@pytest.fixture
def shared() -> Iterator[SharedMemory]:
    made = serve(make_bus())
    yield made
    made.close()


@pytest.fixture
def client(shared: SharedMemory) -> Iterator[Client]:
    with Client(shared.path.name) as made:
        yield made


def test_fields_are_the_entries(shared: SharedMemory, client: Client) -> None:
    array = client.domain_array()
    put_image(shared, bytes(range(1, image_bytes(client) + 1)))
    client.sample()
    assert array.shape == ()
    paths = {signal.path: signal for signal in client.signals()}
    whole = [name for name in array.dtype.names or () if name in paths]
    assert len(whole) == 2 * 8
    for name in whole:
        assert array[name].item() == paths[name].raw, name
    rest = [name for name in array.dtype.names or () if name not in paths]
    assert rest == [f"0/bits{n}" for n in range(6)]
    bits = np.unpackbits(array["0/bits0"], bitorder="little")
    assert bits[:3].tolist() == [1, 0, 0]
    assert (paths["0/out/bit"].raw, paths["0/out/two bits"].raw) == (1, 0)
    u24 = paths["0/out/u24"]
    assert int.from_bytes(array["0/bits1"][:3].tobytes(), "little") == u24.raw
    assert len(SHAPES) > 8


def test_an_array_is_a_view_that_cannot_be_written(shared: SharedMemory, client: Client) -> None:
    array = client.domain_array()
    kept = array.copy()
    field = array["0/in/i8"]
    signal = client.signal("0/in/i8")
    image = bytearray(image_bytes(client))
    image[signal.bit_offset // 8] = 0xFE
    put_image(shared, bytes(image))
    client.sample()
    assert (field.item(), array["0/in/i8"].item(), kept["0/in/i8"].item()) == (-2, -2, 0)
    with pytest.raises(ValueError, match="read-only"):
        array["0/in/i8"] = 1


def test_an_array_outlives_its_client(shared: SharedMemory, client: Client) -> None:
    array = client.domain_array()
    signal = client.signal("0/in/i8")
    image = bytearray(image_bytes(client))
    image[signal.bit_offset // 8] = 5
    put_image(shared, bytes(image))
    client.sample()
    client.close()
    gc.collect()
    assert array["0/in/i8"].item() == 5


def test_there_is_no_such_domain(client: Client) -> None:
    with pytest.raises(UsageError, match=naming("domain 7")):
        client.domain_array(7)


def test_without_numpy(client: Client) -> None:
    program = (
        "import sys; sys.modules['numpy'] = None\n"
        "from ecatd import Client, EcatError\n"
        "try: Client(sys.argv[1]).domain_array()\n"
        "except EcatError as error: print(error)"
    )
    result = subprocess.run(
        [sys.executable, "-c", program, client.name], capture_output=True, text=True, check=True
    )
    assert result.stdout == (
        "domain_array() needs numpy: install it with 'pip install ecatd[numpy]'\n"
    )
