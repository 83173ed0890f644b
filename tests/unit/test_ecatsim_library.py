"""The library of devices: names, parameters, what `ecatsim devices` prints."""

import json

import pytest

from ecatd.model.errors import UsageError
from ecatsim.cli.main import main
from ecatsim.devices.library import library, make
from ecatsim.devices.parameters import Parameter


@pytest.mark.parametrize("item", library(), ids=lambda item: item.name)
def test_every_device_can_be_made_by_its_name(item):
    device = make(item.name)
    assert (device.vendor, device.product, device.revision) == (
        item.vendor,
        item.product,
        item.revision,
    )
    assert make(item.name.lower()).product == device.product
    assert item.summary
    assert not item.summary.endswith(".")


def test_unknown_devices_and_parameters_are_said():
    with pytest.raises(UsageError, match=r"no device 'EL2009': did you mean .*EL2008"):
        make("EL2009")
    with pytest.raises(UsageError, match="The library has EK1100"):
        make("")
    with pytest.raises(UsageError, match="EK1100 has no parameter 'colour': it has none"):
        make("ek1100", colour=1)


@pytest.mark.parametrize(
    ("parameter", "wrong", "message"),
    [
        (Parameter("n", "", 8, 0, 256), -1, "n must be a whole number from 0 to 256, not -1"),
        (Parameter("n", "", 8, 0, 256), 257, "from 0 to 256"),
        (Parameter("n", "", 8, 0, 256), 1.5, "a whole number"),
        (Parameter("n", "", 8, 0), -1, "of at least 0"),
        (Parameter("n", "", 8), True, "a whole number, not True"),
        (Parameter("n", "", 1.0, 0), float("nan"), "a number of at least 0, not nan"),
        (Parameter("n", "", 1.0, 0, 2), float("nan"), "a number from 0 to 2, not nan"),
        (Parameter("n", "", True), 1, "true or false"),
        (Parameter("n", "", "V"), 1, "a text"),
        (Parameter("n", "", 16, choices=(16, 32)), 24, "16 or 32, not 24"),
    ],
)
def test_values_of_parameters_are_checked(parameter, wrong, message):
    with pytest.raises(UsageError, match=message):
        parameter.check("X", wrong)
    parameter.check("X", parameter.default)


def test_a_whole_number_is_a_number():
    Parameter("n", "", 1.5).check("X", 2)


def test_the_command_lists_all_devices(capsys):
    assert main(["devices"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for item in library():
        (line,) = (line for line in lines if line.startswith(item.name + " "))
        assert item.summary in line
        assert f"{item.vendor:08x}:{item.product:08x}:{item.revision:08x}" in line
    assert main(["devices", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["devices"]
    assert [row["name"] for row in rows] == [item.name for item in library()]
    (drive,) = (row for row in rows if row["name"] == "ElmoGold")
    assert (drive["output_size"], drive["input_size"]) == (16, 16)
