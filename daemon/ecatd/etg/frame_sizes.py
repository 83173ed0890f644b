"""The sizes of Ethernet frames with EtherCAT datagrams (ETG.1000.4, 5.3 and 5.4), in bytes.

`daemon/cyclic/engine.h` has the same sizes for the engine. A test compares the two.
"""

ETHERTYPE = 0x88A4

ETHERNET_HEADER = 14
ETHERCAT_HEADER = 2
FIRST_DATAGRAM = ETHERNET_HEADER + ETHERCAT_HEADER
ETHERNET_MIN = 60
"""Shortest frame in bytes. The check sum is not included: the interface adds it."""

DATAGRAM_HEADER = 10
DATAGRAM_WKC = 2
DATAGRAM_FRAMING = DATAGRAM_HEADER + DATAGRAM_WKC

PAYLOAD_MAX = 1498
"""Most bytes of datagrams in one frame. A full frame has 1518 bytes with its check sum."""

DATAGRAM_MAX = PAYLOAD_MAX - DATAGRAM_FRAMING
"""Most bytes of data in one datagram. Such a datagram fills a frame alone."""
