"""Tells a slave its configuration: start-up parameters, and which PDOs it shall exchange.

This is done whenever the slave starts or comes back, in this order (ETG.1000.6):

- in PREOP: the parameters of transition IP, the modules in its slots, then the PDOs, which may
  depend on these, then the parameters of PS;
- in SAFEOP, before OP: the parameters of SO.

On the way down it is told the parameters of OS in OP, and those of SP in SAFEOP (`telling.leave`).

How PDOs are written: `pdo_writer.py`.
"""

from __future__ import annotations

from ecatd.model.bus import Slave
from ecatd.model.config import TRANSITIONS_DOWN, SlaveConfig, StartupConfig
from ecatd.model.errors import SdoAbortError
from ecatd.model.sii import Sii

from ..mailbox.coe import Coe
from ..mailbox.talks import Talk
from .modules import Modules
from .pdo_writer import PdoWriter
from .refused import RefusedError, reason


class SlaveConfiguration:
    """Tells one slave with CoE its configuration.

    Args:
        slave: The slave.
        sii: Its SII.
        coe: CoE of the slave, for one conversation.
        settings: Its table in the configuration.
    """

    def __init__(self, slave: Slave, sii: Sii, coe: Coe, settings: SlaveConfig) -> None:
        self._slave = slave
        self._sii = sii
        self._coe = coe
        self._settings = settings
        self._log = coe.line.log.of("start")

    def tell(self) -> Talk[list[str]]:
        """Tells the slave, which is in PREOP, all that it is told there.

        Returns:
            Messages about parameters that it has refused, although it can be used.

        Raises:
            RefusedError: It refuses its configuration.
            NoAnswerError: It does not answer.
            StateError: Its answers are malformed.
        """
        return self._coe.talk(self._tell)

    def _tell(self) -> Talk[list[str]]:
        refused = yield from self._parameters("IP")
        if self._settings.module:
            modules = Modules(self._slave, self._sii, self._coe)
            yield from self._placed("module", modules.tell(self._settings.modules))
        if self._settings.pdos is not None or self._settings.pdo:
            key = "pdo" if self._settings.pdos is None else "pdos"
            pdos = PdoWriter(self._slave, self._sii, self._coe, self._settings, self._tell_detail)
            yield from self._placed(key, pdos.write())
        return refused + (yield from self._parameters("PS"))

    def _placed(self, key: str, talk: Talk[None]) -> Talk[None]:
        """Adds file, line and key to what the slave refuses."""
        try:
            yield from talk
        except RefusedError as error:
            raise RefusedError(f"{self._settings.table.where(key)}: {error}") from error

    def write_parameters(self, transition: str) -> Talk[list[str]]:
        """Writes the parameters of one transition; returns and raises as `tell`."""
        return self._coe.talk(lambda: self._parameters(transition))

    def _tell_detail(self, what: str) -> None:
        self._log.debug(f"{self._slave.label} is told {what}", slaves=[self._slave.position])

    # --- start-up parameters -------------------------------------------------------------------

    def _parameters(self, transition: str) -> Talk[list[str]]:
        refused = []
        for parameter in self._settings.parameters(transition):
            index, subindex = parameter.address
            self._tell_detail(f"start-up parameter {_text(parameter)} ({transition})")
            try:
                yield from self._coe.download(
                    index, subindex, parameter.data, complete=parameter.complete
                )
            except SdoAbortError as abort:
                text = (
                    f"{parameter.table.where('object')}: {self._slave.label} refuses its start-up "
                    f"parameter {_text(parameter)}: {reason(abort)}"
                )
                if transition in TRANSITIONS_DOWN:
                    refused.append(f"{text}; it goes down all the same")
                elif parameter.optional:
                    refused.append(f"{text}; it is optional, so the slave is used")
                else:
                    raise RefusedError(
                        f"{text}; correct the value, or write optional = true"
                    ) from abort
        return refused


def _text(parameter: StartupConfig) -> str:
    value = parameter.value if parameter.hex is None else parameter.hex
    return f"{parameter.object} = {value}"
