"""Zenoh endpoints are taken apart in one place."""

import pytest

from ecatd.operations.endpoints import Endpoint


@pytest.mark.parametrize(
    ("text", "host", "port", "interface"),
    [
        ("tcp/10.0.0.5:7447", "10.0.0.5", "7447", ""),
        ("tls/[fe80::1]:7448?rel=1#iface=eth0;so_sndbuf=65000", "fe80::1", "7448", "eth0"),
        ("udp/cell4:7447#iface=eth1", "cell4", "7447", "eth1"),
    ],
)
def test_an_endpoint_has_parts_and_is_their_sum(
    text: str, host: str, port: str, interface: str
) -> None:
    endpoint = Endpoint.of(text)
    assert (endpoint.host, endpoint.port, endpoint.interface) == (host, port, interface)
    assert endpoint.is_encrypted == text.startswith("tls")
    assert str(endpoint) == text


@pytest.mark.parametrize("text", ["", "tcp", "tcp/", "/:1", "x#y", "tcp/host#iface", "?#"])
def test_what_is_none_has_no_port_and_no_interface(text: str) -> None:
    endpoint = Endpoint.of(text)
    assert not endpoint.interface
    assert not endpoint.host
