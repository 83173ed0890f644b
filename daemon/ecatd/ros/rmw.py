"""How `rmw_zenoh_cpp` 0.2.4 and later (ROS 2 Jazzy) names things in Zenoh.

Names of files are those of https://github.com/ros2/rmw_zenoh, in `rmw_zenoh_cpp/src/detail/`.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import xxhash

_QOS = "::,{depth}:,:,:,,"
"""Reliable, volatile, keep last, no deadline or lifespan, automatic liveliness: only the depth
differs from the defaults of `qos.cpp`, and what does not is empty (`qos_to_keyexpr`)."""
_ENCLAVE = "/"  # that of a context without security


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic with its type.

    Attributes:
        name: Its whole name, such as `/joint_states`.
        type: Type of its messages as in DDS, such as `sensor_msgs::msg::dds_::JointState_`.
        type_hash: Hash of the description of the type by `rosidl`: `RIHS01_` and 64 digits.
        depth: Messages that are kept.
    """

    name: str
    type: str
    type_hash: str
    depth: int = 10

    def key(self, domain_id: int) -> str:
        """The key of its messages (`TopicInfo` in `liveliness_utils.cpp`)."""
        return f"{domain_id}/{self.name.strip('/')}/{self.type}/{self.type_hash}"


@dataclass(frozen=True, slots=True)
class RosNode:
    """A node, and the tokens by which others find it (`Entity` in `liveliness_utils.cpp`).

    Attributes:
        domain_id: `ROS_DOMAIN_ID`.
        session: ID of the Zenoh session.
        namespace: Namespace of the node, such as `/`.
        name: Its name.
    """

    domain_id: int
    session: str
    namespace: str
    name: str

    @property
    def token(self) -> str:
        """The token of the node, which is number 0 of its session."""
        return self._token("0", "NN")

    def publisher_token(self, number: int, topic: Topic) -> str:
        """The token of a publisher; `number` is 1 or more, and differs for each."""
        about = (topic.name, topic.type, topic.type_hash, _QOS.format(depth=topic.depth))
        return self._token(str(number), "MP", *about)

    def _token(self, number: str, kind: str, *about: str) -> str:
        place = (_ENCLAVE, self.namespace, self.name)
        parts = (str(self.domain_id), self.session, "0", number, kind, *place, *about)
        return "/".join(("@ros2_lv", *(part.replace("/", "%") for part in parts)))


def gid(token: str) -> bytes:
    """The 16 bytes that identify a publisher: the lower half of the hash of its token is first."""
    return xxhash.xxh3_128_digest(token.encode())[::-1]


def attachment(sequence: int, time_ns: int, publisher: bytes) -> bytes:
    """What each message has beside its payload (`attachment_helpers.cpp`).

    Args:
        sequence: Number of the message; the first one of a publisher is 1.
        time_ns: Unix time of publishing.
        publisher: Its `gid`.
    """
    return struct.pack("<qqB16s", sequence, time_ns, len(publisher), publisher)
