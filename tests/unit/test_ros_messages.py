"""What goes to ROS 2, byte by byte as rmw_zenoh (Jazzy) has it, and read by rosbags.

The expected bytes are written by hand from the sources that each test names. They are those of
https://github.com/ros2/rmw_zenoh, in `rmw_zenoh_cpp/src/detail/`, unless another place is named.
"""

import hashlib
import json
import math
from typing import Any

import pytest
from rosbags.typesys import Stores, get_typestore

from conftest import naming
from ecatd.base.errors import ConfigError
from ecatd.config import read_config
from ecatd.ros.messages import (
    DIAGNOSTICS,
    JointState,
    Level,
    Status,
    diagnostic_array,
    joint_states,
)
from ecatd.ros.rmw import RosNode, Topic, attachment, gid

STORE = get_typestore(Stores.ROS2_JAZZY)
JOINT_STATE, ARRAY = "sensor_msgs/msg/JointState", "diagnostic_msgs/msg/DiagnosticArray"
# From the code that rosidl has generated for a micro-ROS of ROS 2 Kilted, which is public:
# hpmicro/hpm_sdk, sensor_msgs/msg/detail/joint_state__description.c and
# diagnostic_msgs/msg/detail/diagnostic_array__description.c.
PUBLISHED = {
    JOINT_STATE: "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    ARRAY: "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
}
TIME_NS = 1_700_000_000_123_456_789


def field(name: str, number: int, nested: str = "") -> dict[str, Any]:
    """A field as `serialize_field` of rosidl_generator_type_description has it."""
    kind = {"type_id": number, "capacity": 0, "string_capacity": 0, "nested_type_name": nested}
    return {"name": name, "type": kind}


NESTED, INT32, UINT32, STRING, DOUBLES, STRINGS = 1, 6, 7, 17, 155, 161
"""Numbers of `FIELD_TYPE_NAME_TO_ID` there."""


def test_the_type_hash_is_that_of_rosidl() -> None:
    """RIHS01: SHA-256 of the JSON of the type and those within it (`calculate_type_hash`)."""
    time = [field("sec", INT32), field("nanosec", UINT32)]
    header = [field("stamp", NESTED, "builtin_interfaces/msg/Time"), field("frame_id", STRING)]
    joint = [
        field("header", NESTED, "std_msgs/msg/Header"),
        field("name", STRINGS),
        *(field(name, DOUBLES) for name in ("position", "velocity", "effort")),
    ]
    description = {
        "type_description": {"type_name": JOINT_STATE, "fields": joint},
        "referenced_type_descriptions": [
            {"type_name": "builtin_interfaces/msg/Time", "fields": time},
            {"type_name": "std_msgs/msg/Header", "fields": header},
        ],
    }
    digest = hashlib.sha256(json.dumps(description).encode()).hexdigest()
    assert joint_states("/").type_hash == f"RIHS01_{digest}"


@pytest.mark.parametrize(
    ("name", "topic"), [(JOINT_STATE, joint_states("/")), (ARRAY, DIAGNOSTICS)]
)
def test_the_type_hash_is_the_published_one(name: str, topic: Topic) -> None:
    assert topic.type_hash == f"RIHS01_{PUBLISHED[name]}" == STORE.hash_rihs01(name)


def test_keys() -> None:
    """`TopicInfo::TopicInfo` in liveliness_utils.cpp: slashes at the ends of a name go.

    The type is `_create_type_name` in type_support_common.cpp.
    """
    assert joint_states("/").key(0) == (
        "0/joint_states/sensor_msgs::msg::dds_::JointState_/"
        "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"
    )
    assert joint_states("/a/b").key(42) == (
        "42/a/b/joint_states/sensor_msgs::msg::dds_::JointState_/"
        "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"
    )
    assert DIAGNOSTICS.key(7) == (
        "7/diagnostics/diagnostic_msgs::msg::dds_::DiagnosticArray_/"
        "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"
    )


def test_liveliness_tokens() -> None:
    """`Entity::Entity` in liveliness_utils.cpp; the last part is `qos_to_keyexpr` there.

    docs/design.md of rmw_zenoh has these tokens of the talker in its examples, with depth 7:
    `@ros2_lv/0/…/0/0/NN/%/%/listener` and `…/0/10/MP/%/%/talker/%chatter/…/::,7:,:,:,,`.
    """
    node = RosNode(0, "8b20917502ee955ac4476e0266340d5c", "/", "talker")
    assert node.token == "@ros2_lv/0/8b20917502ee955ac4476e0266340d5c/0/0/NN/%/%/talker"
    string = "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    chatter = Topic("/chatter", "std_msgs::msg::dds_::String_", f"RIHS01_{string}", depth=7)
    assert node.publisher_token(10, chatter) == (
        "@ros2_lv/0/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/"
        "std_msgs::msg::dds_::String_/"
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18/::,7:,:,:,,"
    )
    node = RosNode(3, "1a", "/cell4/left", "ecatd")
    assert node.token == "@ros2_lv/3/1a/0/0/NN/%/%cell4%left/ecatd"
    assert node.publisher_token(2, joint_states("/cell4/left")) == (
        "@ros2_lv/3/1a/0/2/MP/%/%cell4%left/ecatd/%cell4%left%joint_states/"
        "sensor_msgs::msg::dds_::JointState_/"
        "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e/::,10:,:,:,,"
    )


@pytest.mark.parametrize(
    ("token", "identifier"),
    [  # what simplified_xxhash3.cpp, compiled, says; lower half first, as `Entity` copies it
        ("", "7f498d4624c30160d8984701d306aa99"),
        ("@ros2_lv/0/1a/0/0/NN/%/%/ecatd", "93751e14c8ba863e10c3ef67459d23b5"),
        ("a" * 200, "084003465c4f65c8da79cc258d96fecf"),
        ("a" * 300, "217eebd88175d1c105208db22c3f565e"),
    ],
)
def test_identifiers(token: str, identifier: str) -> None:
    assert gid(token).hex() == identifier


def test_attachment() -> None:
    """`serialize_to_zbytes` in attachment_helpers.cpp, of 0.2.4 and later.

    The serializer of Zenoh writes integers little-endian, and the length of an array before it.
    """
    assert attachment(1, TIME_NS, bytes(range(16))).hex() == (
        "0100000000000000"  # sequence_number_
        "15cd853dfe9c9717"  # source_timestamp_
        "10"
        "000102030405060708090a0b0c0d0e0f"  # source_gid_
    )


def test_joint_state_byte_by_byte() -> None:
    """Fast-CDR 2.2 with `DDS_CDR` (cdr.cpp): fields are aligned to their size behind the header.

    `serialize_encapsulation` writes the header. A sequence is its length, then its items; one
    without items has no padding (`Cdr::serialize_array`).
    """
    state = JointState(TIME_NS, ["hip", "arm1"], [1.5, -2.0], [], [0.25, math.inf])
    assert state.encode().hex(" ", 4) == (
        "00010000 "  # plain CDR, little-endian
        "00f15365 15cd5b07 "  # 1 700 000 000 s, 123 456 789 ns
        "01000000 00000000 "  # frame_id "", its zero, and three bytes of padding
        "02000000 04000000 68697000 05000000 61726d31 00000000 "  # two names, and padding
        "02000000 00000000 "  # two positions; they begin 48 bytes behind the header
        "00000000 0000f83f 00000000 000000c0 "
        "00000000 "  # no velocities, and no padding
        "02000000 "  # two efforts; they begin at 72
        "00000000 0000d03f 00000000 0000f07f"
    )


@pytest.mark.parametrize("names", [[], ["a"], ["hip", "knee", "Gelenk ü"]])
def test_rosbags_reads_a_joint_state(names: list[str]) -> None:
    numbers = [0.1 * n - 3 for n in range(len(names))]
    for columns in ((numbers, numbers, numbers), (numbers, [], numbers), ([], [], [])):
        message = JointState(TIME_NS, names, *columns).encode()
        found: Any = STORE.deserialize_cdr(message, JOINT_STATE)
        assert (found.header.stamp.sec, found.header.stamp.nanosec) == divmod(TIME_NS, 10**9)
        assert (found.header.frame_id, found.name) == ("", names)
        read = (found.position, found.velocity, found.effort)
        assert [list(column) for column in read] == [list(column) for column in columns]
        assert bytes(STORE.serialize_cdr(found, JOINT_STATE)) == message


def test_rosbags_reads_health() -> None:
    statuses = [
        Status(Level.OK, "bus", "8 slaves in OP", "EtherCAT", {"cycle": "1000 µs", "lost": "0"}),
        Status(Level.ERROR, "slave 3 Ventil «ä»", "SAFEOP+ERROR", ""),
        Status(Level.WARN, "", "", "", {"": ""}),
    ]
    message = diagnostic_array(TIME_NS, statuses)
    found: Any = STORE.deserialize_cdr(message, ARRAY)
    assert [(item.level, item.name, item.message, item.hardware_id) for item in found.status] == [
        (item.level, item.name, item.message, item.hardware_id) for item in statuses
    ]
    values = [{pair.key: pair.value for pair in item.values} for item in found.status]
    assert values == [item.values for item in statuses]
    assert bytes(STORE.serialize_cdr(found, ARRAY)) == message


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"connect": "tls/a:7447"}, ("ros.connect", "tls/a:7447", "tcp/HOST:PORT")),
        ({"connect": "tcp/a:0"}, ("ros.connect", "tcp/a:0")),
        ({"connect": "tcp/localhost:7447"}, ("ros.connect", "gateway.listen")),
        ({"joint": [{"slave": 0}]}, ("ros.connect", "missing")),
        ({"connect": "tcp/a:1", "domain_id": 233}, ("ros.domain_id", "233", "232")),
        ({"connect": "tcp/a:1", "node": "a-b"}, ("ros.node", "a-b")),
        ({"connect": "tcp/a:1", "namespace": "cell4"}, ("ros.namespace", "cell4")),
        ({"connect": "tcp/a:1", "namespace": "/a/"}, ("ros.namespace", "/a/")),
        ({"connect": "tcp/a:1", "joint": [{}]}, ("ros.joint[0].slave", "missing")),
        (
            {"connect": "tcp/a:1", "joint": [{"slave": 0, "torque": "x"}]},
            ("ros.joint[0].torque", "effort"),
        ),
    ],
)
def test_what_is_wrong_is_refused(table: dict[str, Any], message: tuple[str, ...]) -> None:
    with pytest.raises(ConfigError, match=naming(*message)):
        read_config({"ros": table})


def test_it_is_off_by_default() -> None:
    assert not read_config({}).ros.connect
