"""What ROS 2 sees of the bus: `[ros]`."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Annotated

from ecatd.base.toml_file import Key, Table, accepts, integer, number, show
from ecatd.operations.endpoints import Endpoint

from .gateway import GatewayConfig, is_loopback, is_port
from .placed import Placed, each, read
from .references import position_or_name

_TOKEN = "[A-Za-z_][A-Za-z0-9_]*"
_NODE, _NAMESPACE = re.compile(_TOKEN), re.compile(f"/|(/{_TOKEN})+")
_LONGEST = 255  # of node and namespace together, in ROS 2
DOMAIN_MAX = 232


@accepts("`tcp/HOST:PORT`")
def _router(table: Table, key: Key) -> str:
    text = table.text(key)
    place = Endpoint.of(text)
    if text and not (place.protocol == "tcp" and place.host and is_port(place.port)):
        table.fail(
            key,
            f"{show(text)} is not the address of a Zenoh router of ROS 2: write tcp/HOST:PORT, "
            'such as "tcp/192.168.1.5:7447"',
        )
    return text


@accepts("letters, digits and _, no digit first")
def _node(table: Table, key: Key) -> str:
    name = table.text(key)
    if not _NODE.fullmatch(name) or len(name) > _LONGEST:
        table.fail(
            key,
            f"{show(name)} cannot be the name of a node of ROS 2: it has letters, digits and _, "
            "and no digit first",
        )
    return name


@accepts('`"/"`, or names as of `node` with a `/` before each')
def _namespace(table: Table, key: Key) -> str:
    name = table.text(key)
    if not _NAMESPACE.fullmatch(name) or len(name) > _LONGEST:
        table.fail(
            key,
            f'{show(name)} is not a namespace of ROS 2: write "/", or names of letters, digits '
            'and _ with a / before each, such as "/cell4"',
        )
    return name


@accepts("a text")
def _name(table: Table, key: Key) -> str:
    name = table.text(key)
    if not name.isprintable():
        table.fail(key, f"{show(name)} cannot be a name: it has control characters")
    return name


@dataclass(slots=True)
class JointConfig(Placed):
    """`[[ros.joint]]`: a joint of `joint_states`.

    Without `position`, `velocity` and `effort`, the joint has those of 0x6064, 0x606C and 0x6077
    that the slave sends, which are these values of a drive with CiA 402.

    Attributes:
        slave: The drive: its position on the bus, or its name.
        name: Name of the joint, as in the robot description. Default: the name of the slave.
        axis: Axis of a drive with several, 0 first: its objects are 0x800 apart.
        position: Input of the slave with the position, in a unit of an angle or a length.
            Default: see above.
        velocity: Input with the velocity. Default: see above.
        effort: Input with the torque or the force. Default: see above.
    """

    slave: Annotated[int | str, position_or_name]
    name: Annotated[str, _name] = ""
    axis: Annotated[int, integer(0, 7)] = 0
    position: Annotated[str, _name] = ""
    velocity: Annotated[str, _name] = ""
    effort: Annotated[str, _name] = ""


@dataclass(slots=True)
class RosConfig(Placed):
    """`[ros]`: joints and health of the bus for [ROS 2](ros2-joints.md).

    Attributes:
        connect: The Zenoh router of ROS 2 (`rmw_zenohd`), such as `"tcp/192.168.1.5:7447"`. ecatd
            connects to it, again and again until it succeeds. `""`: ROS 2 sees nothing.
        domain_id: `ROS_DOMAIN_ID` of those who are to see the bus.
        namespace: Namespace of the node, and of `joint_states`.
        node: Name of the node.
        rate_hz: Rate of `joint_states`; it is never more than that of the cycles of the bus.
        joint: The joints. None: only `/diagnostics` is published.
    """

    connect: Annotated[str, _router] = ""
    domain_id: Annotated[int, integer(0, DOMAIN_MAX)] = 0
    namespace: Annotated[str, _namespace] = "/"
    node: Annotated[str, _node] = "ecatd"
    rate_hz: Annotated[float, number(0.1, 1000)] = 50.0
    joint: Annotated[list[JointConfig], each(JointConfig)] = field(default_factory=list)


def read_ros(top: Table, key: Key) -> RosConfig:
    """Reads `[ros]`."""
    table = top.table(key)
    config = read(RosConfig, table)
    if config.joint and not config.connect:
        table.fail(
            "connect",
            'is missing: name the Zenoh router of ROS 2, such as "tcp/192.168.1.5:7447"',
        )
    return config


def check_router(config: RosConfig, gateway: GatewayConfig) -> None:
    """Checks that the router of ROS 2 is not the gateway of this bus.

    Raises:
        ConfigError: It is.
    """
    router = Endpoint.of(config.connect)
    for endpoint in map(Endpoint.of, gateway.listen):
        if endpoint.port == router.port and is_loopback(endpoint.host) and is_loopback(router.host):
            config.table.fail(
                "connect",
                f"{show(config.connect)} is the gateway of this bus itself (gateway.listen), which "
                "passes nothing of ROS 2 on: let one of both have another port, or set "
                "gateway.listen = []",
            )
