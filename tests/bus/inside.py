"""What tests do in the network namespace of a simulator: `python inside.py PID COMMAND …`.

A process of its own, since only one without threads can enter a namespace.
"""

import fcntl
import socket
import struct
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

from ecatd.base import network_namespace as namespace
from ecatsim.net import netlink

DELLINK, REQUEST_ACK = 17, 5


def switch(interface, state):
    """Switches an interface on or off, as an administrator does."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        request = struct.pack("16sH14x", interface.encode(), 0)
        (flags,) = struct.unpack("16xH14x", fcntl.ioctl(control, 0x8913, request))
        flags = flags | 1 if state == "up" else flags & ~1
        fcntl.ioctl(control, 0x8914, struct.pack("16sH14x", interface.encode(), flags))


def mtu(interface, size=""):
    """Sets the MTU of an interface, or prints it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        request = struct.pack("16si12x", interface.encode(), int(size or 0))
        answer = fcntl.ioctl(control, 0x8922 if size else 0x8921, request)
        if not size:
            print(struct.unpack("16xi12x", answer)[0])


def bridge(interface, name):
    """Makes a bridge, and an interface a part of it."""
    subprocess.run(["ip", "link", "add", name, "type", "bridge"], check=True)
    subprocess.run(["ip", "link", "set", interface, "master", name], check=True)
    subprocess.run(["ip", "link", "set", name, "up"], check=True)


def is_on(interface):
    """Whether it is switched on."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        request = struct.pack("16sH14x", interface.encode(), 0)
        (flags,) = struct.unpack("16xH14x", fcntl.ioctl(control, 0x8913, request))
        return bool(flags & 1)


def delete(interface):
    """Takes an interface away, and with it its peer."""
    index = socket.if_nametoindex(interface)
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as link:
        link.bind((0, 0))
        body = struct.pack("=BxHiII", socket.AF_UNSPEC, 0, index, 0, 0)
        link.send(struct.pack("=IHHII", 16 + len(body), DELLINK, REQUEST_ACK, 1, 0) + body)
        (code,) = struct.unpack_from("=i", link.recv(4096), 16)
        assert code == 0, code


def make(interface, peer):
    """Makes a pair of interfaces, of which the first is off, as those of new devices are."""
    set_up = netlink.set_up
    netlink.set_up = lambda name: set_up(name) if name == peer else None
    netlink.create_veth(peer, interface)


def send(interface, frame, count, pause):
    """Sends a frame again and again."""
    raw = socket.socket(socket.AF_PACKET, socket.SOCK_RAW)
    raw.bind((interface, 0x88A4))
    for _ in range(int(count)):
        raw.send(bytes.fromhex(frame))
        time.sleep(float(pause))


def replay(interface, peer, seconds):
    """Sends answers of another run: those of this one with another number and other inputs."""
    raw = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(0x88A4))
    raw.bind((interface, 0x88A4))
    out = socket.socket(socket.AF_PACKET, socket.SOCK_RAW)
    out.bind((peer, 0x88A4))
    end = time.monotonic() + float(seconds)
    while time.monotonic() < end:
        data, address = raw.recvfrom(2048)
        if data[17] < 0x80 or address[2] == socket.PACKET_OUTGOING or data[7:11] == b"old!":
            continue
        old = bytearray(data)
        old[7:11] = b"old!"
        at, more = 16, True
        while more:
            length = int.from_bytes(old[at + 6 : at + 8], "little")
            more, length = bool(length & 0x8000), length & 0x7FF
            if old[at] >= 10:
                old[at + 10 : at + 10 + length] = b"\xff" * length
            at += 12 + length
        out.send(old)


def soem(interface, seconds):
    """Another master with SOEM, which brings the slaves to OP and exchanges process data."""
    import pysoem

    master = pysoem.Master()
    master.open(interface)
    assert master.config_init() > 0
    master.config_map()
    end = time.monotonic() + float(seconds)
    while time.monotonic() < end:
        master.send_processdata()
        master.receive_processdata(2000)
        time.sleep(0.001)
    master.close()


def soem_scan(interface):
    """Another master with SOEM, which only looks what is there."""
    import pysoem

    master = pysoem.Master()
    master.open(interface)
    assert master.config_init() > 0
    master.close()


def kickcat_scan(interface):
    """Another master, which shares no code with SOEM, and only looks what is there."""
    import kickcat

    bus = kickcat.Bus(kickcat.create_link(interface, ""))
    bus.init(0.0)


def echo(address, *sizes):
    """Sends datagrams to the echo service, each until it comes back."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        udp.settimeout(1)
        udp.connect((address, 7))
        for size in map(int, sizes):
            data, tries = bytes(n & 0xFF for n in range(size)), 60
            udp.send(data)
            while (back := _received(udp)) != data:
                tries -= back is None
                assert tries, f"{size} bytes do not come back"
                if back is None:
                    udp.send(data)


def _received(udp):
    try:
        return udp.recv(2048)
    except OSError:  # nothing comes, or nobody is there yet
        return None


def _network(pid):
    return Path(f"/proc/{pid}/ns/net").readlink()


def fetch(interface, address, size):
    """Moves an interface into a network of its own, and fetches a file from a web server there."""
    serve = f"""
import subprocess, sys
sys.stdin.readline()
for command in ("addr add {address}/24 dev {interface}", "link set {interface} up"):
    subprocess.run(["ip", *command.split()], check=True)
from http.server import *
class Handler(BaseHTTPRequestHandler):
    def do_GET(self):
        self.send_response(200)
        self.end_headers()
        self.wfile.write(b"x" * {size})
HTTPServer(("{address}", 80), Handler).handle_request()
"""
    command = ["unshare", "--net", sys.executable, "-c", serve]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as server:
        try:
            while _network(server.pid) == _network("self"):
                time.sleep(0.01)
            move = ["ip", "link", "set", interface, "netns", str(server.pid)]
            subprocess.run(move, check=True)
            server.stdin.write(b"\n")
            server.stdin.flush()
            deadline = time.monotonic() + 60
            while True:
                try:
                    with urllib.request.urlopen(f"http://{address}/", timeout=30) as answer:
                        assert answer.read() == b"x" * int(size)
                        break
                except OSError:  # it does not listen yet
                    assert time.monotonic() < deadline
        finally:
            server.kill()


if __name__ == "__main__":
    namespace.join(int(sys.argv[1]))
    commands = (
        switch,
        mtu,
        bridge,
        delete,
        make,
        send,
        replay,
        echo,
        fetch,
        soem,
        soem_scan,
        kickcat_scan,
    )
    {command.__name__: command for command in commands}[sys.argv[2]](*sys.argv[3:])
