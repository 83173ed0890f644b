"""A terminal gets what `[slave.can]` says, and its process data must be those of the table.

The terminal here has fixed process data for queues of ten frames, and no CAN bus.
"""

from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon, names
from ecatd.etg.can_terminals import EL6751, PROFILE_29

pytestmark = pytest.mark.bus

QUEUE = 10
TYPES = {1: "USINT", 2: "UINT", 4: "UDINT", 8: "ULINT"}
SUBINDEX_0 = """
<SubItem><SubIdx>0</SubIdx><Name>SubIndex 000</Name><Type>USINT</Type><BitSize>8</BitSize>
<BitOffs>0</BitOffs><Flags><Access>rw</Access></Flags></SubItem>
"""


def record(index: int, subindices: dict[int, int]) -> tuple[str, str]:
    """A data type and an object with these subindices, each with its number of bytes."""
    items, at = SUBINDEX_0, 16
    for subindex, size in subindices.items():
        items += (
            f"<SubItem><SubIdx>{subindex}</SubIdx><Name>s{subindex}</Name><Type>{TYPES[size]}</Type>"
            f"<BitSize>{8 * size}</BitSize><BitOffs>{at}</BitOffs>"
            "<Flags><Access>rw</Access></Flags></SubItem>"
        )
        at += 8 * size
    name = f"DT{index:04X}"
    return (
        f"<DataType><Name>{name}</Name><BitSize>{at}</BitSize>{items}</DataType>",
        f"<Object><Index>#x{index:04X}</Index><Name>{name}</Name><Type>{name}</Type>"
        f"<BitSize>{at}</BitSize></Object>",
    )


def pdo(kind: str, manager: int, index: int, size: int) -> str:
    entries = "".join(
        f"<Entry><Index>#x{0x6001 if kind == 'TxPdo' else 0x7001:04X}</Index>"
        f"<SubIndex>{1 + n}</SubIndex><BitLen>8</BitLen><Name>b{n}</Name>"
        "<DataType>USINT</DataType></Entry>"
        for n in range(size)
    )
    return (
        f'<{kind} Sm="{manager}" Fixed="1"><Index>#x{index:04X}</Index><Name>p</Name>'
        f"{entries}</{kind}>"
    )


def esi() -> str:
    """EL6751 as `ecatsim` can make it of an ESI file."""
    objects = {
        item.index: {one.subindex: one.size for one in item.settings} for item in EL6751.objects
    }
    objects[0x8001] = {1: 8}
    made = [record(index, subindices) for index, subindices in objects.items()]
    outputs, status = PROFILE_29.output_bytes(QUEUE), PROFILE_29.status.size
    inputs = PROFILE_29.input_bytes(QUEUE) - status
    sms = "".join(
        f'<Sm DefaultSize="{size}" StartAddress="#x{start:04X}" ControlByte="#x{control:02X}" '
        f'Enable="1">{name}</Sm>'
        for size, start, control, name in (
            (128, 0x1000, 0x26, "MBoxOut"),
            (128, 0x1080, 0x22, "MBoxIn"),
            (outputs, 0x1800, 0x64, "Outputs"),
            (inputs + status, 0x2400, 0x20, "Inputs"),
        )
    )
    pdos = pdo("RxPdo", 2, 0x1600, outputs) + pdo("TxPdo", 3, 0x1A00, inputs)
    pdos += pdo("TxPdo", 3, 0x1A85, status).replace("#x6001", "#xF108")
    return f"""<EtherCATInfo><Vendor><Id>#x{EL6751.vendor:08X}</Id><Name>V</Name></Vendor>
<Descriptions><Groups><Group><Type>C</Type><Name>C</Name></Group></Groups><Devices>
<Device Physics="YY"><Type ProductCode="#x{EL6751.product:08X}" RevisionNo="#x00140000">CAN1</Type>
<Name>CAN</Name><GroupType>C</GroupType><Profile><ProfileNo>5001</ProfileNo><Dictionary>
<DataTypes>{"".join(kind for kind, _ in made)}</DataTypes>
<Objects>{"".join(item for _, item in made)}</Objects></Dictionary></Profile>
<Fmmu>Outputs</Fmmu><Fmmu>Inputs</Fmmu>{sms}{pdos}
<Mailbox DataLinkLayer="true"><CoE SdoInfo="true" CompleteAccess="1"/></Mailbox>
<Eeprom><ByteSize>8192</ByteSize><ConfigData>0800000000000000</ConfigData></Eeprom>
</Device></Devices></Descriptions></EtherCATInfo>"""


@pytest.fixture
def machine(start_daemon: Callable[..., Daemon], tmp_path: Path) -> Callable[..., Daemon]:
    def start(can: str, **more: object) -> Daemon:
        file, rig = tmp_path / "can.xml", tmp_path / "rig.toml"
        file.write_text(esi())
        device = f'[[slave]]\nesi = "{file}"\ntype = "CAN1"\n'
        rig.write_text(f'name = "m"\n[[slave]]\ndevice = "EK1100"\n{device}')
        tables = f'[[slave]]\nposition = 1\nname = "can"\n{can}'
        return start_daemon(str(rig), config=f"[gateway]\nlisten = []\n{tables}", **more)

    return start


def test_a_terminal_is_told_its_settings_whenever_it_starts(
    machine: Callable[..., Daemon], tmp_path: Path
) -> None:
    daemon = machine("[slave.can]\nbit_rate = 250\nreceive_queue = 10\n")
    rows = daemon.ctl_json("startup", "verify")["parameters"]
    found = {row["object"]: row for row in rows}
    names(found["0xF800:02"]["configured"], 3)
    names(found["0x8000:21"]["configured"], QUEUE)
    names(found["0x8001:00"]["configured"], "1f")
    ends = {row["object"]: row["result"] for row in rows}  # of each object the last row
    assert set(ends.values()) == {"as configured"}
    daemon.ctl("sdo-write", "can", "0xF800", "2", "0", "--type", "uint8")
    assert daemon.ctl("startup", "verify", check=False).returncode == 7
    daemon.ctl("state", "can", "INIT", "--yes")
    daemon.ctl("state", "can", "OP")
    assert daemon.ctl("startup", "verify").returncode == 0
    other = tmp_path / "other.toml"
    other.write_text(daemon.config_file.read_text().replace("= 10", "= 12"))
    checked = daemon.ctl_json("config", "check", str(other))
    assert not checked["wrong"]
    names(*checked["notes"], "slave 1 (can, CAN1)", 154, 166, 182, 198)


def test_other_process_data_are_refused_with_both_lengths(
    machine: Callable[..., Daemon],
) -> None:
    with pytest.raises(Exception, match="CAN1") as refused:
        machine("[slave.can]\nbit_rate = 250\nreceive_queue = 12\n")
    names(refused.value, "slave 1 (can, CAN1)", 154, 182, 166, 198, "receive_queue = 12")
