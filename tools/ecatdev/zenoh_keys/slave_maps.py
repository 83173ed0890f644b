"""Maps about one slave, and about what is in it."""

from __future__ import annotations

from typing import NotRequired, TypedDict

from ecatd.etg.port_errors import PortErrors

from .bus_maps import Error


class Objects(TypedDict):
    """The objects of a slave.

    Attributes:
        objects: The index of each.
    """

    objects: list[int]


class ObjectDescription(TypedDict):
    """What an object is.

    Attributes:
        index: Its index.
        name: Its name.
        code: Its kind: 7 a variable, 8 an array, 9 a record, or another number of the slave.
        data_type: Its CoE data type index; of a record that of its structure.
        entries: Its entries.
    """

    index: int
    name: str
    code: int
    data_type: int
    entries: list[ObjectEntry]


class ObjectEntry(TypedDict):
    """An entry of an object.

    Attributes:
        subindex: Its subindex.
        name: Its name.
        data_type: Its CoE data type index.
        bit_length: Its length in bits.
        access: Its access rights, bits as in ETG.1000.6.
        unit: Unit code (ETG.1004), 0 for none.
        default: Its value as the device is delivered, as SDO data; None: not known.
        minimum: Its smallest value, as SDO data; None: not known.
        maximum: Its largest one.
    """

    subindex: int
    name: str
    data_type: int
    bit_length: int
    access: int
    unit: int
    default: bytes | None
    minimum: bytes | None
    maximum: bytes | None


class Sdo(TypedDict):
    """The value of an object, as it was uploaded or downloaded.

    Attributes:
        data: Its bytes, little endian.
        name: Name of the object; may be empty.
        data_type: Its CoE data type index; where nobody knows it, an unsigned type of that size, or
            OCTET_STRING.
        unit: Unit of the physical value. It, `scale` and `offset` are there if they are known.
        scale: Physical value = value * scale + offset.
        offset: See `scale`; in `unit`.
    """

    data: bytes
    name: str
    data_type: int
    unit: NotRequired[str]
    scale: NotRequired[float]
    offset: NotRequired[float]


class Data(TypedDict):
    """Bytes.

    Attributes:
        data: As read: of registers after a write those that they have then, of a file empty at its
            end.
    """

    data: bytes


class Errors(TypedDict):
    """Error counters.

    Attributes:
        slaves: Those of each slave that answers.
    """

    slaves: list[SlaveCounters]


class SlaveCounters(TypedDict):
    """The error counters of a slave.

    Attributes:
        position: Its position.
        ports: Those of its ports, by number.
        processing: Errors of the processing unit: frames that are not EtherCAT, or malformed.
        pdi: Errors of the process data interface.
        since: Unix time at which ecatd cleared them; None if it has not.
    """

    position: int
    ports: list[PortErrors]
    processing: int
    pdi: int
    since: float | None


class Written(TypedDict):
    """The end of a write of an EEPROM.

    Attributes:
        written: How many words had other values.
    """

    written: int


class Ethernet(TypedDict):
    """The interface to slaves with [EoE](ethernet.md).

    Attributes:
        interface: Its name; empty if the configuration has none.
        address: Its IP address with the size of the network; may be empty.
        problem: Why it does not work, or empty.
        sent: Frames sent to this computer.
        received: Frames received from this computer.
        dropped: Frames that no slave wanted, or that came too fast.
        slaves: The slaves with EoE. Without an interface they have no counters.
    """

    interface: str
    address: str
    problem: str
    sent: int
    received: int
    dropped: int
    slaves: list[EthernetSlave]


class EthernetSlave(TypedDict):
    """A slave with EoE.

    Attributes:
        slave: Its position.
        name: Its name.
        sent: Frames sent to it.
        received: Frames received from it.
        dropped: Frames to it that came too fast.
        lost: Frames of which a part was lost.
        macs: MAC addresses that it was heard with.
    """

    slave: int
    name: str
    sent: NotRequired[int]
    received: NotRequired[int]
    dropped: NotRequired[int]
    lost: NotRequired[int]
    macs: NotRequired[list[str]]


class Ip(TypedDict):
    """IP parameters of a slave; None for each that it has not.

    Attributes:
        mac: MAC address.
        address: IP address.
        mask: The mask of its network.
        gateway: Default gateway.
        dns: DNS server.
        name: DNS name.
        before: After a write: those from before.
    """

    mac: str | None
    address: str | None
    mask: str | None
    gateway: str | None
    dns: str | None
    name: str | None
    before: NotRequired[Ip]


class Idn(TypedDict):
    """An IDN of a drive.

    Attributes:
        idn: The IDN.
        name: Its name.
        attribute: The 32 bits of element 3.
        unit: Its unit; may be empty.
        value: The bytes of its value, of a list without its lengths.
        before: After a write: the bytes from before.
    """

    idn: int
    name: str
    attribute: int
    unit: str
    value: bytes
    before: NotRequired[bytes]


class Transfer(TypedDict):
    """A transfer of a file.

    Attributes:
        transfer: Its number, which only the client knows that has started it.
        step: `receiving` from the client, `to boot`, `transferring`, `from boot`, `done`, `failed`.
        received: Bytes that have come from the client.
        size: Bytes of a file that is written; None for one that is read.
        moved: Bytes that have gone over the bus.
        busy: What a busy slave says; empty if it is not busy.
        failure: The error, after a failure.
        note: A remark about the end; may be empty.
    """

    transfer: int
    step: str
    received: int
    size: int | None
    moved: int
    busy: str
    failure: Error | None
    note: str
