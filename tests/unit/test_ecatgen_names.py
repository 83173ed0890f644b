"""Identifiers from texts: readable where the text is usual, valid and unique always."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecatd.base.errors import UsageError
from ecatgen.names import (
    MAX_LENGTH,
    Namespace,
    class_name,
    component_name,
    connector_names,
    instance_name,
    library_name,
)
from ecatgen.words import WORDS

TEXTS = st.text(max_size=220)


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("EL1018", "EL1018"),
        ("EL1018 8K. Dig. Eingang 24V, 10µs", "EL1018"),
        ("EL3008-0010", "EL3008_0010"),
        ("Gold EtherCAT GCON Drive", "GoldGCONDrive"),
        ("AKD EtherCAT Drive (CoE)", "AKDDriveCoE"),
        ("SERVO DRIVE", "ServoDrive"),
        ("750-354", "Slave750_354"),
        ("Größe", "Grosse"),
        ("EtherCAT", "Fallback"),
        ("", "Fallback"),
        ("日本", "Fallback"),
    ],
)
def test_class_names(text: str, name: str) -> None:
    assert class_name(text, "Fallback") == name


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("Target velocity", "targetVelocity"),
        ("Max. Torque", "maxTorque"),
        ("AI Standard Channel 1 Value", "aiStandardChannel1Value"),
        ("Status__TxPDO Toggle", "statusTxPDOToggle"),
        ("Limit 1 2", "limit1_2"),
        ("TARGET VELOCITY", "targetVelocity"),
        ("DI 1", "di1"),
        ("24V supply", "entry24VSupply"),
        ("µm/°C", "umDegC"),
        ("***", ""),
    ],
)
def test_component_names(text: str, name: str) -> None:
    assert component_name(text) == name


@pytest.mark.parametrize(
    ("class_", "name"),
    [("EL3008_2", "el3008_2"), ("GoldGCONDrive", "goldGCONDrive"), ("ELMOGold", "elmoGold")],
)
def test_instance_names(class_: str, name: str) -> None:
    assert instance_name(class_) == name


def test_a_connector_is_called_like_its_entry_where_that_is_unique() -> None:
    entries = [
        ("Channel 1", "Input", "object 6000 01"),
        ("Channel 2", "Input", "object 6010 01"),
        ("Status", "Error", "object 6020 01"),
        ("", "", "object 6030 01"),
        ("", "", "object 6030 02"),
        ("", "time", "object 6030 03"),
        ("Outputs", "for", "object 6030 04"),
        ("", "Same", "object 6030 05"),
        ("", "same", "object 6030 06"),
    ]
    assert connector_names(entries, ["committed"]) == [
        "channel1Input",
        "channel2Input",
        "error",
        "object6030_01",
        "object6030_02",
        "timeEntry",
        "outputsFor",
        "same",
        "same_2",
    ]


@given(st.lists(st.tuples(TEXTS, TEXTS), max_size=12))
def test_connectors_are_valid_and_unique_whatever_the_vendor_wrote(
    texts: list[tuple[str, str]],
) -> None:
    entries = [(pdo, entry, f"object 7000 {n:02X}") for n, (pdo, entry) in enumerate(texts)]
    names = connector_names(entries, ["domainID"])
    assert len({name.casefold() for name in names}) == len(entries)
    for name in names:
        assert re.fullmatch(r"[a-z][A-Za-z0-9]*(_[0-9][A-Za-z0-9]*)*", name)
        assert name not in WORDS
        assert name != "domainID"
        assert len(name) <= MAX_LENGTH + 16


@given(TEXTS)
def test_r39_classes_are_valid_whatever_the_vendor_wrote(text: str) -> None:
    name = class_name(text, "Slave00030924")
    assert re.fullmatch(r"[A-Z][A-Za-z0-9]*(_[0-9][A-Za-z0-9]*)*", name)
    assert len(name) <= MAX_LENGTH + len("Slave")
    assert re.fullmatch(r"[a-z][A-Za-z0-9]*(_[0-9][A-Za-z0-9]*)*", instance_name(name))


def test_case_does_not_make_names_different() -> None:
    namespace = Namespace(["EtherCAT"], suffix="Slave")
    taken = [namespace.take(name) for name in ("EL1", "El1", "EL1", "EtherCAT", "Real", "EL1_2")]
    assert taken == ["EL1", "El1_2", "EL1_3", "EtherCATSlave", "RealSlave", "EL1_2_2"]


@pytest.mark.parametrize("name", ["TrollPlant", "Plant_2", "p"])
def test_library_names(name: str) -> None:
    assert library_name(name) == name


@pytest.mark.parametrize(
    "name",
    [
        *("", "9Plant", "Troll-Plant", "a b", "_x", "Größe", "x" * 49, "a\n", "../x"),
        *("model", "Real", "time", "EtherCAT", "ETHERCAT", "Modelica", "Complex"),
    ],
)
def test_names_that_no_library_can_have(name: str) -> None:
    with pytest.raises(UsageError, match=r"choose another|cannot be the name"):
        library_name(name)
