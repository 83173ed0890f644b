"""How the frames of the cycle carry the process image."""

from __future__ import annotations

from .operation import Map, Operation


class ImageDatagram(Map):
    """A piece of the image of a domain that one datagram carries (ETG.1000.4)."""

    command: int  #: 10 for LRD, 11 for LWR, 12 for LRW.
    address: int  #: Its logical address.
    offset: int  #: Its first byte in the image of the domain.
    length: int  #: Its bytes.
    wkc_expected: int  #: Its working counter when all its slaves take part.
    #: The group of optional slaves in the domain that it carries; -1 for slaves that must be there.
    group: int
    #: Number, in the domain and from 1 on, of the outputs or inputs of a slave that several
    #: datagrams carry, which count together or not at all; 0 for all others.
    split: int


class DomainImage(Map):
    """The image of a domain: outputs, then inputs."""

    output_bytes: int  #: Bytes of outputs.
    input_bytes: int  #: Bytes of inputs.
    datagrams: list[ImageDatagram]  #: What carries them.


class ProcessImage(Map):
    """The process image of a bus."""

    domains: list[DomainImage]  #: Its domains, by number.


class ReadImage(Operation[ProcessImage]):
    """Asks which datagrams carry which bytes of the process image."""

    op = "image"
    key = "ro/image"
