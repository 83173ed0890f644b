"""Reads rig files (TOML): the slaves, and their connections outside the bus.

See `docs/simulator-rigs.md`, "Rig and device files". Paths are relative to the folder of the file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ecatd.base.errors import ConfigError
from ecatd.base.files import is_folder
from ecatd.base.toml_file import Key, Table, read_toml, show

from .. import faults
from ..devices import library
from ..esc import MAX_SLAVES
from ..plants.point import Terminal
from ..rig import Rig
from ..slave.device import Device
from . import (
    any_device,
    device_file,
    python_file,
    rig_can,
    rig_fmu,
    rig_links,
    rig_waveforms,
    sources,
)
from .esi import device_from_esi

_KEYS = ("name", "ring", "slave", "can", "wire", "waveform", "plant", "fault")
_IDENTITY = ("alias", "serial", "device_id")
_PLACE = ("at", "ports_exchanged", *_IDENTITY)
_SOURCES = ("device", "esi")
_U16, _U32 = 0xFFFF, 0xFFFFFFFF
_SHOWN = 8


def load(path: Path) -> Rig:
    """Reads a rig from a file.

    Raises:
        ConfigError: The file, or a file that it names, cannot be used.
    """
    table = read_toml(path)
    if "product" in table and "slave" not in table:
        table.fail(
            "product",
            "belongs to a device file, but this must be a rig file: write one with "
            f'[[slave]] and device = "{path.name}"',
        )
    table.only(_KEYS)
    rig = Rig(table.text("name", path.stem))
    rows = table.tables("slave")
    if len(rows) > MAX_SLAVES:
        table.fail("slave", f"has {len(rows)} slaves, but a segment has at most {MAX_SLAVES}")
    rig.devices = [_slave(row, number) for number, row in enumerate(rows)]
    slaves = list(zip(rows, rig.devices, strict=True))
    rig_links.connect(table, rows, rig)
    rig.exchanged = [device for row, device in slaves if row.boolean("ports_exchanged", False)]
    rig_can.read(table, rig, _from_file)
    driven: set[Terminal] = set()
    for row in table.tables("wire"):
        row.only(("from", "to", "scale", "offset"))
        source = _terminal(row, "from", rig)
        target = _driven(row, rig, driven)
        rig.connect_entries(source, target, row.number("scale", 1.0), row.number("offset", 0.0))
    for row in table.tables("waveform"):
        rig.drive(_driven(row, rig, driven), rig_waveforms.read(row))
    for row in table.tables("plant"):
        _add_plant(row, rig)
    for row in table.tables("fault"):
        rig.faults.append(faults.parse(row.data, row.where(), path.parent, len(rig.devices)))
    return rig


# --- slaves --------------------------------------------------------------------------------------


def _slave(table: Table, number: int) -> Device:
    if "device" in table:
        device = _named_device(table)
    elif "esi" in table:
        device = _esi_device(table)
    elif "sii" in table or "vendor" in table:
        table.only((*device_file.keys(), *_PLACE))
        return any_device.read(table, f"Slave {number}")
    else:
        known = (*_SOURCES, *device_file.keys(), *_PLACE)
        table.only(dict.fromkeys(known))
        table.fail(
            None,
            'names no device: it needs `device = "EL2004"` (see `ecatsim devices`) or the name of '
            "a file, `sii`, `esi`, or `vendor` and `product`",
        )
    _identify(table, device)
    return device


def _identify(table: Table, device: Device) -> None:
    """Sets alias, serial number and device identification.

    Alias and serial number also change in the SII image, even if the image comes from a file.
    """
    if not any(key in table for key in _IDENTITY):
        return
    if "device_id" in table:
        device.device_id = table.integer("device_id", 0, _U16)
    device.alias = table.integer("alias", 0, _U16, device.alias)
    device.serial = table.integer("serial", 0, _U32, device.serial)
    if "serial" in table and 0x1018 in device.dictionary:
        entries = device.dictionary.object(0x1018).entries
        if 4 in entries:
            entries[4].value = device.serial
    image = table.explain(None, device.sii_image)
    wanted = sources.patched(image, device.alias, device.serial)
    if image != wanted:
        vars(device)["sii_image"] = lambda: wanted


def _named_device(table: Table) -> Device:
    """Makes a device of the library, of a device file, or of a class in a Python file."""
    table.only(("device", "parameters", *_PLACE))
    text = table.text("device")
    name, colon, _ = text.rpartition(":")
    if text.endswith(".toml"):
        if "parameters" in table:
            table.fail("parameters", "belong to devices of the library or of Python files")
        return any_device.load(_existing(table, "device", text))
    parameters = _parameters(table)
    if text.endswith(".py") or (colon and name.endswith(".py")):
        made = _from_file(table, text, parameters)
        if not isinstance(made, Device):
            table.fail("device", f"'{text}' does not make an ecatsim.Device")
        return made
    return table.explain("device", lambda: library.make(text, **parameters))


def _from_file(table: Table, text: str, parameters: dict[str, Any]) -> object:
    """Makes what `device` names with the name of a Python file and a class in it."""
    name, _, class_name = text.rpartition(":")
    if text.endswith(".py"):
        table.fail("device", f'names no class: write "{text}:ClassName"')
    path = _existing(table, "device", name)
    return _call(path, python_file.get(path, class_name), parameters)


def _parameters(table: Table) -> dict[str, Any]:
    parameters = table.table("parameters", None)
    return parameters.data if parameters is not None else {}


def _existing(table: Table, key: str, text: str, *, folder: bool = False) -> Path:
    path = table.document.folder / text
    try:
        found = path.is_file() or (folder and is_folder(path))
    except ValueError:  # a path with a NUL character
        found = False
    if not found:
        table.fail(key, f"there is no file '{path}'")
    return path


def _call(path: Path, function: Any, parameters: dict[str, Any], *arguments: object) -> object:
    if not callable(function):
        raise ConfigError(f"{path}: {show(function)} is neither a class nor a function")
    made: object = python_file.explained(path, lambda: function(*arguments, **parameters))
    return made


def _esi_device(table: Table) -> Device:
    table.only(("esi", "type", "product", "revision", "modules", "strict", *_PLACE))
    path = _existing(table, "esi", table.text("esi"), folder=True)
    product, revision = _code(table, "product"), _code(table, "revision")
    kind = table.text("type") if "type" in table else None
    modules = table.array("modules", _module) if "modules" in table else []
    device: Device = table.explain(
        "esi",
        lambda: device_from_esi(
            path, kind, product, revision, modules, strict=table.boolean("strict", False)
        ),
    )
    return device


def _code(table: Table, key: Key) -> str | int | None:
    """Reads a product code or revision: a number, or a text such as "0x03FA3052"."""
    if isinstance(table.data.get(key), str):
        return table.text(key)
    return table.integer(key, 0, _U32, None)


def _module(table: Table, key: Key) -> str | int:
    """Reads the type or the ident of a module."""
    return table.text(key) if isinstance(table.data[key], str) else table.integer(key, 0, _U32)


# --- connections ---------------------------------------------------------------------------------


def _terminal(table: Table, key: str, rig: Rig) -> Terminal:
    """Reads the terminal that `from` (an output) or `to` (an input) names."""
    where = table.table(key)
    where.only(("slave", "entry"))
    count = len(rig.devices)
    if not count:
        where.fail("slave", "there are no slaves to connect")
    slave = where.integer("slave", 0, count - 1)
    address = where.address("entry")
    device = rig.devices[slave]
    known = [
        entry
        for pdo in (device.rx_pdos if key == "from" else device.tx_pdos)
        for entry in pdo.entries
        if not entry.is_gap
    ]
    if address not in [(entry.index, entry.subindex) for entry in known]:
        kind = "output" if key == "from" else "input"
        names = ", ".join(entry.address for entry in known[:_SHOWN])
        more = ", …" if len(known) > _SHOWN else ""
        has = f"it has {names}{more}" if known else "it has none"
        where.fail(
            "entry",
            f"slave {slave} ({device.order}) has no {kind} {where.data['entry']}; {has}",
        )
    return (device, *address)


def _driven(table: Table, rig: Rig, driven: set[Terminal]) -> Terminal:
    """Reads the terminal in `to`, which only one wire, waveform or `loopback` may drive."""
    target = _terminal(table, "to", rig)
    device, index, subindex = target
    loops = device.loops if isinstance(device, device_file.DescribedDevice) else ()
    followers = [(entry.index, entry.subindex) for _, entry in loops]
    other = "another wire or waveform" if target in driven else "its `loopback`"
    if target in driven or (index, subindex) in followers:
        table.table("to").fail("entry", f"is driven by {other} already")
    driven.add(target)
    return target


def _add_plant(table: Table, rig: Rig) -> None:
    """Adds an FMU, or the plant that a function or class of a Python file makes for the rig."""
    if "fmu" in table:
        rig_fmu.add(table, rig)
        return
    table.only(("python", "fmu", "parameters", "period", "catch_up"))
    if "python" not in table:
        table.fail(None, 'needs `python = "motor.py:Motor"` or `fmu = "motor.fmu"`')
    name, colon, function = table.text("python").rpartition(":")
    if not colon or not name.endswith(".py"):
        table.fail("python", 'must be a file and a name in it, as in "motor.py:Motor"')
    path = _existing(table, "python", name)
    made = _call(path, python_file.get(path, function), _parameters(table), rig)
    if not callable(made):
        table.fail("python", f"{function} in '{path}' does not make a function of the time")
    period = table.number("period", 0.001, low=1e-6, high=3600.0)
    rig.add_plant(made, period, table.number("catch_up", 0.1, low=0.0))
