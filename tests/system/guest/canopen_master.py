"""Runs in the machine: a CANopen master on `vcan0`, with the package `canopen`."""

import sys
import time

import canopen

NODE, PATIENCE_S = 2, 60.0

network = canopen.Network()
network.connect(interface="socketcan", channel="vcan0")
end = time.monotonic() + PATIENCE_S
while NODE not in network.scanner.nodes:
    if time.monotonic() > end:
        sys.exit("no node answers")
    network.scanner.search()
    time.sleep(1)
node = network.add_node(canopen.RemoteNode(NODE, canopen.ObjectDictionary()))
node.sdo.RESPONSE_TIMEOUT = PATIENCE_S
print(network.scanner.nodes)
print(node.sdo.upload(0x1008, 0).decode())  # in segments
network.disconnect()
