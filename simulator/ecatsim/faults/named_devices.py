"""Makes the devices that faults name: from the library or from files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ecatd.base.errors import ConfigError, UsageError
from ecatd.etg.intel_hex import image_bytes
from ecatd.etg.sii_check import MAX_IMAGE

from ..slave.device import Device

_IMAGES = (".bin", ".sii", ".eeprom", ".hex")


def absolute(device: str, folder: Path) -> str:
    """Returns a device name, with an absolute path if it is a file."""
    return str((folder / device).absolute()) if _is_file(device) else device


def make(device: str) -> Device:
    """Makes a new device.

    Args:
        device: A name of the library (`ecatsim devices`), or a file: a device file `x.toml`, a
            class of a Python file `x.py:Class`, or an SII image `x.bin`.

    Raises:
        UsageError: There is no such device, or its file cannot be used.
    """
    # Imported here, since the modules that read rig files import the faults.
    from ..devices import library
    from ..files import any_device, python_file, sii_image

    path = Path(device)
    if path.suffix == ".toml":
        return any_device.load(path)
    if path.suffix in _IMAGES:
        told: list[str] = []
        made = sii_image.device_from_sii(read_image(path, told.append), device)
        made.remarks = [*told, *made.remarks]
        return made
    file, _, name = device.rpartition(":")
    if path.suffix == ".py":
        raise UsageError(f"'{device}' names no class: write {path.name}:Class")
    if file.endswith(".py"):
        kind = python_file.get(Path(file), name)
        if not callable(kind):
            raise ConfigError(f"{file}: {name} is not a class of a device")
        made = python_file.explained(Path(file), kind)
        if not isinstance(made, Device):
            raise ConfigError(f"{file}: {name} does not make an ecatsim.Device")
        python_file.explained(Path(file), made.sii_image)
        return made
    return library.make(device)


def read_image(path: Path, tell: Callable[[str], None] = lambda _: None) -> bytes:
    """Reads an SII image.

    Args:
        path: The file.
        tell: Called with what is missing in it. As the content of a fault, it may be anything.

    Raises:
        UsageError: The file cannot be read, or is too large.
    """
    try:
        if not path.is_file():
            raise UsageError(f"there is no file '{path}'")
        with path.open("rb") as file:
            image = image_bytes(file.read(4 * MAX_IMAGE), str(path), tell)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise UsageError(f"'{path}' cannot be read: {reason}") from error
    if len(image) > MAX_IMAGE:
        raise UsageError(f"'{path}' is too large: an SII image has at most {MAX_IMAGE >> 10} KiB")
    return image


def _is_file(device: str) -> bool:
    return Path(device.partition(":")[0]).suffix in (".toml", ".py", *_IMAGES)
