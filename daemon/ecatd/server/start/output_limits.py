"""Changes the limits of outputs while the bus runs, from the configuration to the engine."""

from __future__ import annotations

from copy import deepcopy

from ecatd.config import Config
from ecatd.config.expected_bus import compare
from ecatd.config.meanings import raw_parameters, without_meanings
from ecatd.config.resolve import check_slaves, resolve_config
from ecatd.description.bus import Bus
from ecatd.etg.pdo import Entry

from .reading import with_eeprom_pdos
from .running_bus import RunningBus

_NAMED = 8
"""Most outputs beyond their new limits that are named."""


class OutputLimits:
    """The limits of all outputs of a bus that runs."""

    def __init__(self, running: RunningBus) -> None:
        found = running.found
        self._bus = found.bus
        self._shared = running.shared
        self._engine = running.engine
        self._profiles = running.profiles
        self._eeproms = [item.sii for item in found.scanned]
        self._wire = list(found.master.wire)
        self._uncertain, self._idle = frozenset(found.uncertain), frozenset(found.idle)

    def check(self, config: Config) -> Bus:
        """Applies a configuration with other limits to a copy of the bus, with the start's checks.

        Args:
            config: The configuration, with the positions that it expects.

        Returns:
            The copy of the bus, with the new limits.

        Raises:
            ConfigError: A safe value or a start-up parameter is beyond its limits, or a table does
                not fit the bus.
            StateError: A slave does not exist.
        """
        wanted = without_meanings(deepcopy(self._bus))
        found = compare(config, wanted.slaves)
        unexpected = found.unexpected
        here = config.moved({n: at for n, at in found.places.items() if at not in unexpected})
        check_slaves(here, wanted)
        for slave, sii in zip(wanted.slaves, self._eeproms, strict=True):
            if slave.position not in self._uncertain:
                settings = here.settings_of(slave.position)
                known = with_eeprom_pdos(slave, sii)
                raw_parameters(settings, known, self._profiles, here.signal)
        resolve_config(here, wanted, self._profiles, self._wire, self._uncertain, self._idle)
        return wanted

    def use(self, wanted: Bus) -> list[str]:
        """Takes over the limits of a bus that `check` has returned; waits for the engine.

        Returns:
            Texts that name the outputs whose values were beyond the limits. These outputs are at
            the nearer limit now.
        """
        for entry, new in zip(_outputs(self._bus), _outputs(wanted), strict=True):
            entry.minimum, entry.maximum = new.minimum, new.maximum
        self._shared.set_limits()
        held = self._engine.use_limits(_NAMED + 1)
        rows = [self._shared.signals[signal] for signal in held[:_NAMED]]
        return [
            f"0x{row.index:04X}:{row.subindex:02X} of {self._bus.slaves[row.slave].label}"
            for row in rows
        ] + ["others"] * (len(held) > _NAMED)


def _outputs(bus: Bus) -> list[Entry]:
    return [entry for slave in bus.slaves for _, entry, _ in slave.entries(outputs=True)]
