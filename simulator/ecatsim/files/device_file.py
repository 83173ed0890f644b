"""Device files: a slave described in TOML (`docs/simulator-rigs.md`, "Rig and device files").

Every attribute of `Device` has a key of the same name; a missing one is derived from the others or
has its default. A description may also start from an SII image, and then change it and add to it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ecatd.base.errors import ConfigError, EcatError
from ecatd.base.toml_file import Table
from ecatd.etg.pdo import Pdo

from ..slave import sync_managers
from ..slave.device import Device
from ..slave.objects import Dictionary, Variable
from ..slave.sii import SmType
from . import device_attributes, device_objects, sources

_OTHERS = ("pdo", "object", "sii", "strict", "complete_dictionary")
_OF_DRIVES = ("drive", "unit", "deviation", "unknown", "source")
_U16, _U32 = 0xFFFF, 0xFFFFFFFF
_RAM = 0x1000
_LATE_OBJECTS = (0x1C00,)
"""Objects that are made last, from all the others."""


def keys() -> tuple[str, ...]:
    """Returns all keys that a device file may have."""
    return (*device_attributes.keys(), *_OTHERS, *_OF_DRIVES)


def read(table: Table, name: str) -> Device:
    """Reads a device from a table, whose keys have been checked against `keys`.

    Args:
        table: The table.
        name: Order code and name if the table has none.

    Raises:
        ConfigError: The table cannot be used; the message names file, line and key.
    """
    for key in _OF_DRIVES:
        if key in table:
            table.fail(key, "belongs to a drive, which has a table `drive`")
    strict = table.boolean("strict", False) if "strict" in table else None
    if "strict" in table and "sii" not in table:
        table.fail(
            "strict", "belongs beside `sii`: it says whether an image with mistakes is refused"
        )
    base = sources.sii(table, "sii", strict=strict) if "sii" in table else None
    return _Reader(table, base, name).device()


def read_attributes(table: Table, name: str) -> dict[str, Any]:
    """Reads identity, texts, mailbox and PDOs: attributes for a class of devices.

    Raises:
        ConfigError: A key or value in the table is wrong.
    """
    return _Reader(table, None, name).attributes()


class DescribedDevice(Device):
    """A device made from a description instead of a class.

    Args:
        attributes: Attributes of `Device`.
        describe: Function that adds the objects to the dictionary.
        image: Its SII image, or None to build it from the attributes.
    """

    def __init__(
        self,
        attributes: dict[str, Any],
        describe: Callable[[Dictionary], None],
        image: bytes | None = None,
    ) -> None:
        for name, value in attributes.items():
            setattr(self, name, value)
        self._image = image
        self._describe = describe
        self.loops: list[tuple[Variable, Variable]] = []
        super().__init__()

    def describe(self) -> None:
        """Adds the objects of the description."""
        self._describe(self.dictionary)

    def keep(self, listed: set[tuple[int, int]]) -> None:
        """Removes all entries that are neither listed nor in PDOs, and objects left without any."""
        for pdo in (*self.rx_pdos, *self.tx_pdos):
            listed = listed | {(entry.index, entry.subindex) for entry in pdo.entries}
        for item in list(self.dictionary):
            for subindex in list(item.entries):
                if (item.index, subindex) not in listed:
                    del item.entries[subindex]
            if not item.entries:
                self.dictionary.remove(item.index)

    def sii_image(self) -> bytes:
        """Returns the SII image that the description started from, or builds one."""
        if self._image is None:
            return super().sii_image()
        return sources.patched(self._image, self.alias, self.serial)

    def step(self, now: float) -> None:
        """Copies outputs to the inputs that follow them (`loopback`)."""
        del now
        for output, entry in self.loops:
            entry.value = output.value

    def rests(self) -> bool:
        """Always: an input follows its output, whenever that is."""
        return True


class _Reader:
    """Reads one device."""

    def __init__(self, table: Table, base: Device | None, name: str) -> None:
        self._table = table
        self._base = base
        self._name = name
        self._attributes: dict[str, Any] = {}
        self._listed: dict[int, set[int]] = {}
        if base is not None:
            self._attributes = {key: getattr(base, key) for key in device_attributes.attributes()}

    def attributes(self) -> dict[str, Any]:
        table = self._table
        if self._base is None:
            for key in ("vendor", "product"):
                table.integer(key, 0, _U32)  # required keys
        device_attributes.read(table, self._attributes)
        self._read_name()
        if "pdo" in table:
            self._read_pdos(table.tables("pdo"))
        if self._base is None:  # a real image is not checked
            self._check_memory()
        return self._attributes

    def device(self) -> Device:
        table, pdos = self._table, self._table.tables("pdo")
        self.attributes()
        device = self._make()
        self._apply_objects(device.dictionary, late=True)
        if table.boolean("complete_dictionary", False):
            device.keep({(index, sub) for index, subs in self._listed.items() for sub in subs})
        device.loops = self._loops(device, pdos)
        device.remarks = self._base.remarks if self._base else []
        return device

    def _make(self) -> DescribedDevice:
        image = self._base.sii_image() if self._base else None
        try:
            device = DescribedDevice(self._attributes, self._describe, image)
            device.sii_image()
        except ConfigError:
            raise
        except EcatError as error:
            self._table.fail(None, str(error))
        return device

    def _read_name(self) -> None:
        known = self._attributes
        name = known.get("order") or known.get("name") or self._name
        known.setdefault("order", device_objects.wire_text(self._table, "order", name))

    def _read_pdos(self, rows: list[Table]) -> None:
        pdos: dict[int, Pdo] = {}
        outputs = any(
            row.data.get("index") in device_objects.OUTPUTS and row.data.get("assigned", True)
            for row in rows
            if isinstance(row.data.get("index"), int)
        )
        for row in rows:
            pdo = device_objects.read_pdo(row, lambda at, out: self._channel(at, out, outputs))
            if pdo.index in pdos:
                row.fail("index", f"is 0x{pdo.index:04X} a second time")
            pdos[pdo.index] = pdo
        for key, indices in (
            ("rx_pdos", device_objects.OUTPUTS),
            ("tx_pdos", device_objects.INPUTS),
        ):
            self._attributes[key] = tuple(pdo for pdo in pdos.values() if pdo.index in indices)

    def _channel(self, table: Table, output: bool, any_outputs: bool) -> int:
        """Returns the number of the sync manager that carries a PDO."""
        managers = self._attributes.get("sync_managers")
        if managers is not None:
            wanted = SmType.OUTPUTS if output else SmType.INPUTS
            for number, manager in enumerate(managers):
                if manager.type == wanted:
                    return number
            table.fail(
                None, f"there is no sync manager for {wanted.name.lower()} to carry this PDO"
            )
        if self._attributes.get("mailbox"):
            return 2 if output else 3
        return 0 if output else int(any_outputs)

    def _check_memory(self) -> None:
        """Checks that mailboxes and process data fit into the memory of the chip."""
        known = self._attributes
        managers = known.get("sync_managers")
        if managers is None:
            sizes = (
                sync_managers.default_size(known.get(key, ())) for key in ("rx_pdos", "tx_pdos")
            )
            managers = sync_managers.derive(known.get("mailbox"), *sizes)
        end = _RAM + 1024 * known.get("chip", Device.chip).ram_kib
        for manager in managers:
            if manager.start + manager.size > end:
                key = next(key for key in ("sync_manager", "pdo", "mailbox") if key in self._table)
                word = device_attributes.WORDS[manager.type]
                place = f"0x{manager.start:04X} to 0x{manager.start + manager.size - 1:04X}"
                self._table.fail(
                    key,
                    f"the sync manager of type {word} would take {place}, but the memory of the "
                    f"chip ends at 0x{end - 1:04X} (chip.ram_kib)",
                )

    def _describe(self, dictionary: Dictionary) -> None:
        for row in self._table.tables("pdo"):
            device_objects.initial_values(row, dictionary)
        self._apply_objects(dictionary, late=False)

    def _apply_objects(self, dictionary: Dictionary, *, late: bool) -> None:
        """Adds or changes objects; with `late`, those that the device makes last."""
        for row in self._table.tables("object"):
            if (row.data.get("index") in _LATE_OBJECTS) == late:
                found = device_objects.apply_object(dictionary, row)
                if self._listed.keys() & found.keys():
                    row.fail("index", f"is 0x{next(iter(found)):04X} a second time")
                self._listed |= found

    def _loops(self, device: Device, pdos: list[Table]) -> list[tuple[Variable, Variable]]:
        outputs = {(e.index, e.subindex) for pdo in device.rx_pdos for e in pdo.entries}
        loops = []
        for row in (row for pdo in pdos for row in pdo.tables("entry")):
            source = row.address("loopback", None)
            if source is None:
                continue
            if source not in outputs:
                row.fail("loopback", f"is {row.data['loopback']}, which no output PDO has")
            target = device.dictionary.mapped(
                row.integer("index", 1, _U16), row.integer("subindex", 0, 255, 0)
            )
            loops.append((device.dictionary.mapped(*source), target))
        return loops
