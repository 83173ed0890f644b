"""The services of systemd that run a bus: their names, why one does not run, and what to do.

Bus `ecat0` has the services `ecatd` and `ecatd-gateway`; any other bus has `ecatd@BUS` and
`ecatd-gateway@BUS`. An administrator may also have started `ecat0` as `ecatd@ecat0`.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from ecatd.base.paths import MACHINE
from ecatd.base.version import VERSION

_ASK_S = 5
"""Seconds that systemd has for an answer."""
_PROPERTIES = ("Id", "LoadState", "ActiveState")


class Advice(NamedTuple):
    """Why something does not run.

    Attributes:
        text: What is known.
        remedy: What to do.
    """

    text: str
    remedy: str


class _Unit(NamedTuple):
    """The state of a service in systemd; `not-found` and `inactive` without systemd."""

    name: str
    load: str = "not-found"
    active: str = "inactive"

    @property
    def is_there(self) -> bool:
        return self.load != "not-found"

    @property
    def is_on_the_way(self) -> bool:
        return self.active in ("activating", "reloading", "deactivating")

    def advice(self) -> Advice:
        """Why it does not run."""
        start = f"'systemctl start {self.name}'"
        if self.load == "masked":
            remedy = f"'systemctl unmask {self.name}', then {start}"
            return Advice(f"service {self.name} is masked", remedy)
        if self.is_on_the_way:
            return Advice(
                f"service {self.name} is {self.active}", f"'systemctl status {self.name}'"
            )
        if self.active == "failed":
            remedy = f"'journalctl -u {self.name} -n 20' says why"
            return Advice(f"service {self.name} has failed", remedy)
        return Advice(f"service {self.name} does not run", start)


def service(bus: str) -> str:
    """Returns the name of the service that runs a bus."""
    return f"ecatd{_instance(bus)}"


def gateway(bus: str) -> str:
    """Returns the name of the service that runs the gateway of a bus."""
    return f"ecatd-gateway{_instance(bus)}"


def _instance(bus: str) -> str:
    return "" if bus == "ecat0" else f"@{bus}"


def how_to_start(bus: str) -> str:
    """Returns advice for messages if no daemon runs."""
    name = "" if bus == "ecat0" else f" --bus {bus}"
    return (
        f"start it with 'systemctl start {service(bus)}', or without hardware with 'ecatd "
        f"--simulate troll{name}'"
    )


def why_not_running(bus: str) -> Advice | None:
    """Returns why no daemon of this machine runs a bus; None if the bus has no service."""
    from ecatd.base.failure_record import find_record  # seldom needed: only if a bus does not run

    unit, _ = _units(bus)
    if not unit.is_there or unit.is_on_the_way:
        name = unit.name if unit.is_there else service(bus)
        if (record := find_record(bus)) is not None:
            remedy = f"remove the cause; 'systemctl restart {name}' tries at once"
            return Advice(str(record), remedy)
    if not unit.is_there:
        return None
    may_start = unit.load != "masked" and unit.active == "inactive"
    if may_start and not (MACHINE / f"{bus}.toml").exists():
        remedy = f"'ecatctl --bus {bus} service install --interface IF' writes one"
        return Advice(f"service {unit.name} has no configuration", remedy)
    return unit.advice()


def why_no_gateway(bus: str) -> Advice | None:
    """Returns why a running bus has no gateway; None if the gateway starts by itself."""
    of_bus, unit = _units(bus)
    runs = unit.active == "active" or unit.is_on_the_way
    return None if of_bus.active != "active" or not unit.is_there or runs else unit.advice()


def other_version(bus: str, running: str) -> Advice | None:
    """Returns advice if another version of ecatd than this one runs a bus; else None."""
    if running == VERSION:
        return None
    remedy = f"'systemctl restart {service(bus)}', when the machine may stop"
    return Advice(f"the bus is run by version {running}, and this is {VERSION}", remedy)


def _units(bus: str) -> tuple[_Unit, _Unit]:
    """Returns the service of a bus and that of its gateway, by the names that are in use."""
    names = [(service(bus), gateway(bus))]
    if bus == "ecat0":
        names.append(("ecatd@ecat0", "ecatd-gateway@ecat0"))
    found = _show([name for pair in names for name in pair])
    pairs = [(found.get(a, _Unit(a)), found.get(b, _Unit(b))) for a, b in names]
    return next((pair for pair in pairs if pair[0].active != "inactive"), pairs[0])


def _show(names: list[str]) -> dict[str, _Unit]:
    import subprocess  # seldom needed, as above

    if not Path("/run/systemd/system").is_dir():  # sd_booted(3)
        return {}
    command = ["systemctl", "show", f"--property={','.join(_PROPERTIES)}"]
    try:
        shown = subprocess.run(
            [*command, *(f"{name}.service" for name in names)],
            capture_output=True,
            timeout=_ASK_S,
            check=True,
            text=True,
        ).stdout
    except (OSError, subprocess.SubprocessError):
        return {}
    found = {}
    for part in shown.split("\n\n"):
        values = dict(line.partition("=")[::2] for line in part.splitlines())
        name = values.get("Id", "").removesuffix(".service")
        found[name] = _Unit(name, *(values.get(key, "") for key in _PROPERTIES[1:]))
    return found
