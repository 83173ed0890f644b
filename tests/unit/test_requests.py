"""Requests from outside: right ones pass, wrong ones are refused by name."""

from typing import Annotated, Any

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from conftest import naming
from ecatd.base.errors import ConfigError, EcatError, SdoAbortError, UsageError
from ecatd.etg.error_codes import abort_error
from ecatd.gateway.gateway import Gateway
from ecatd.gateway.history import Histories
from ecatd.gateway.streams import Streams
from ecatd.gateway.traces import Traces
from ecatd.master.ethernet.traffic import EthernetTraffic
from ecatd.operations.bus import ReadRights
from ecatd.operations.catalog import OPERATIONS, parse
from ecatd.operations.encoding import unpack
from ecatd.operations.fields import Field, Printable, Verbatim
from ecatd.operations.objects import SdoRead
from ecatd.operations.operation import Operation, to_map
from ecatd.operations.query import from_query, to_query
from ecatd.operations.registers import ReadRegister
from ecatd.operations.streams import OpenStream
from ecatd.server.requests.dictionaries import Dictionaries
from ecatd.server.requests.eeproms import Eeproms
from ecatd.server.requests.ethernet import Ethernet
from ecatd.server.requests.files import Files
from ecatd.server.requests.hands import Hands
from ecatd.server.requests.idns import Idns
from ecatd.server.requests.incidents import Incidents
from ecatd.server.requests.objects import Objects
from ecatd.server.requests.registers import Registers
from ecatd.server.requests.requests import Requests
from ecatd.server.requests.wire import Wire
from ecatd.server.server import BusServer
from request_samples import SAMPLES, VALUES


@pytest.mark.parametrize("request_", [SdoRead("all", 0x1018), *SAMPLES])
def test_requests_survive(request_: Any) -> None:
    assert parse(to_map(request_)) == request_
    key, parameters, payload = to_query(request_)
    assert from_query(key, parameters, payload or {}) == request_
    assert all(part and not set(part) & set("/*$?#") for part in key)


def test_a_rule_is_not_another_one_with_the_same_number() -> None:
    assert Printable(10) != Verbatim(10)
    fields = [Field.of(Annotated[str, rule(10)] | None) for rule in (Printable, Verbatim)]
    assert [field.rule for field in fields] == [Printable(10), Verbatim(10)]


@pytest.mark.parametrize(
    ("data", "what"),
    [
        ([], "is a map"),
        ({}, "op None is not a request"),
        ({"op": ["sdo_read"]}, "is not a request"),
        ({"op": "sdo_read", "slave": 0}, "sdo_read | index"),
        ({"op": "sdo_read", "slave": -1, "index": 1}, "'slave' | sdo_read | -1"),
        ({"op": "sdo_read", "slave": True, "index": 1}, "'slave' | int | bool"),
        ({"op": "sdo_read", "slave": 0.0, "index": 1}, "'slave' | int | float"),
        ({"op": "sdo_read", "slave": 0, "index": 0x10000}, "'index' | 65536 | 0 | 65535"),
        ({"op": "sdo_read", "slave": 0, "index": 1, "subindex": 256}, "'subindex' | 256 | 0 | 255"),
        ({"op": "sdo_read", "slave": 0, "index": 1, "sub": 1}, "'sub' | sdo_read"),
        ({"op": "sdo_write", "slave": 0, "index": 1, "data": "x"}, "'data' | bytes | str"),
        ({"op": "sdo_write", "slave": 0, "index": 1, "data": b""}, "'data' | 0 bytes"),
        ({"op": "sdo_write", "slave": 0, "index": 1}, "sdo_write | 'data' | 'value'"),
        ({"op": "sdo_write", "slave": 0, "index": 1, "value": 5}, "'value' | str | int"),
        (
            {"op": "sdo_write", "slave": 0, "index": 1, "value": "5", "data": b"5"},
            "sdo_write | 'data' | 'value'",
        ),
        ({"op": "set_state", "state": "RUN"}, "'RUN' | AL state"),
        ({"op": "set_state", "state": "OP", "slave": -1}, "'slave' | -1 | 0"),
        ({"op": "set_log_level", "level": "loud"}, "'loud' | error | debug"),
        ({"op": "set_log_level", "level": "info", "part": "sdo"}, "'sdo' | service | mailbox"),
        ({"op": "set_log_level", "level": "info", "by": "me\nerror: x"}, "'by' | printable"),
        ({"op": "set_log_level", "level": "info", "by": "x" * 201}, "'by' | 200"),
        ({"op": "describe", "x": 1}, "'x' | describe"),
        ({"op": "sdo_read", "op2": 1}, "'op2' | slave | index | subindex | complete"),
    ],
)
def test_r35_wrong_requests_are_refused(data: Any, what: str) -> None:
    with pytest.raises(UsageError, match=naming(*what.split(" | "))):
        parse(data)


ANYTHING = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**63)
    | st.floats()
    | st.text()
    | st.binary(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=8,
)
MAPS = [{}, *map(to_map, SAMPLES)]
FIELDS = sorted({"op", "x"}.union(*MAPS))
OPS = st.sampled_from([*OPERATIONS])
USUAL = st.sampled_from([value for values in VALUES.values() for value in values])


def changed(data: dict[str, Any]) -> st.SearchStrategy[dict[str, Any]]:
    """Maps like this one, but for some fields: mostly those that it has."""
    fields = st.sampled_from([*data] or FIELDS) | st.sampled_from(FIELDS)
    others = st.dictionaries(fields, ANYTHING | OPS | USUAL, max_size=4)
    return others.map(lambda values: {**data, **values})


@given(st.sampled_from(MAPS).flatmap(changed))
def test_r35_anything_is_a_request_or_a_usage_error(data: dict[str, Any]) -> None:
    try:
        request = parse(data)
    except UsageError:
        return
    assert parse(to_map(request)) == request
    if data.get("slave") == "":
        with pytest.raises(UsageError, match=naming("'slave'", "empty")):
            to_query(request)
        return
    key, parameters, payload = to_query(request)
    assert from_query(key, parameters, payload or {}) == request


@given(st.binary(max_size=200))
def test_any_bytes_are_a_map_or_a_usage_error(data: bytes) -> None:
    try:
        message = unpack(data)
    except UsageError:
        return
    assert all(isinstance(key, str) for key in message)


def test_every_kind_of_request_is_known_and_tried() -> None:
    """`test_zenoh_keys.py` sees that each is documented."""
    kinds = {kind for kind in Operation.__subclasses__() if kind.__module__.startswith("ecatd.")}
    assert {*OPERATIONS.values()} == kinds == {*map(type, SAMPLES)}


def test_long_and_nested_messages_are_refused() -> None:
    with pytest.raises(UsageError, match="too long"):
        unpack(msgpack.packb({"x": b"\0" * 70000}))
    with pytest.raises(UsageError, match="not a msgpack"):
        unpack(b"\x81\xa1x" + b"\x91" * 60000)


def test_errors_survive_the_way_through_a_reply() -> None:
    error = EcatError.from_reply(abort_error(0x06020000).to_reply())
    assert isinstance(error, SdoAbortError)
    assert error.code == 0x06020000
    assert "does not exist" in str(error)
    assert isinstance(EcatError.from_reply(UsageError("x").to_reply()), UsageError)
    placed = EcatError.from_reply(ConfigError("cycle: is 0", "a.toml", 3).to_reply())
    assert isinstance(placed, ConfigError)
    assert (placed.file, placed.problem, str(placed)) == (
        "a.toml",
        "cycle: is 0",
        "a.toml:3: cycle: is 0",
    )
    assert "file" not in ConfigError("there is no file").to_reply()
    assert type(EcatError.from_reply({"name": "new", "message": "m"})) is EcatError


def test_a_program_is_told_what_an_operation_does_not_have() -> None:
    with pytest.raises(UsageError, match=naming("'lenght'", "size")):
        ReadRegister(0, 0x0130, lenght=2)  # type: ignore[call-arg]
    with pytest.raises(UsageError, match=naming("3", "4")):
        ReadRegister(0, 0x0130, 2, 2)  # type: ignore[call-arg]


@pytest.mark.parametrize("user", ["anna", "7up", "all", "anna@press.example", "a_b-c.d"])
def test_the_name_of_a_user_stands_in_a_key_as_it_is(user: str) -> None:
    """Zenoh compares it with the rules of `gateway/access.py`."""
    query = to_query(ReadRights(user))
    assert query.key == ("as", user, "ro", "rights")
    assert from_query(query.key, "", {}) == ReadRights(user)
    for wrong in ("", "a/b", "a*", "an%6Ea", "x" * 65):
        with pytest.raises(UsageError):
            ReadRights(wrong)


def test_every_operation_has_one_handler() -> None:
    marked = [
        kind
        for owner in (
            *(BusServer, Requests, EthernetTraffic, Gateway, Files, Objects, Dictionaries),
            *(
                Registers,
                Eeproms,
                Ethernet,
                Idns,
                Hands,
                Incidents,
                Wire,
                Streams,
                Traces,
                Histories,
            ),
        )
        for method in vars(owner).values()
        if (kind := getattr(method, "handles", None)) is not None
    ]
    assert sorted(kind.op for kind in marked) == sorted(OPERATIONS)


def test_a_whole_number_is_a_float_where_that_is_asked_for() -> None:
    assert OpenStream("*", 304) == OpenStream("*", 304.0)
    with pytest.raises(UsageError, match=naming("'hz'", "too large")):
        OpenStream("*", 10**400)
