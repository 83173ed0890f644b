"""Lays out the process image, checks its timing, and sets the slaves up for it."""

from __future__ import annotations

from dataclasses import dataclass

from ecatd.base.coroutine_steps import finish
from ecatd.base.log import Log
from ecatd.config import Config
from ecatd.config.meanings import unused_profiles
from ecatd.config.profiles import Profiles
from ecatd.config.resolve import ResolvedConfig, resolve_config
from ecatd.master.engine.process_image import Image, lay_out

from .clock_registers import measure_round_trip
from .clocks import Clocks
from .found_bus import FoundBus
from .mapping import configure, without_lrw
from .watchdogs import check_watchdogs
from .wire_time import WireTime, wire_time


@dataclass(frozen=True, slots=True)
class ProcessData:
    """The process data that are exchanged with the slaves, and their timing.

    Attributes:
        resolved: The configuration, resolved on this bus.
        image: The process image.
        wire: The time that the frames of a cycle take on the wire.
        clocks: The distributed clocks, if the configuration enables them.
    """

    resolved: ResolvedConfig
    image: Image
    wire: WireTime
    clocks: Clocks | None


def set_up_process_data(found: FoundBus, profiles: Profiles, log: Log) -> ProcessData:
    """Maps the slaves into a process image, and measures their clocks. They must be in PREOP.

    Raises:
        ConfigError: The configuration does not fit this bus.
        StateError: A slave does not answer.
    """
    bus, config, master = found.bus, found.config, found.master
    resolved = resolve_config(config, bus, profiles, master.wire, found.uncertain, found.idle)
    for warning in unused_profiles(bus, profiles):
        log.warning(warning)
    for copy in resolved.copies:
        if copy.missing:
            log.warning(copy.missing)
    for sentence in resolved.safe.unguarded:
        log.warning(sentence)
    for channel in resolved.can:
        for remark in channel.remarks:
            log.warning(remark)
    channels = {channel.slave for channel in resolved.can}
    image = lay_out(bus, without_lrw(master, found.present), channels)
    wire = wire_time(
        image,
        config.cycle_time_us,
        len(bus.slaves),
        clock=config.dc.enabled,
        delay_ns=measure_round_trip(master),
    )
    if warning := wire.check():
        log.warning(warning)
    finish(configure(master, found.present, image))
    for warning in finish(check_watchdogs(master, bus, found.present, config)):
        log.warning(warning)
    _warn_of_unused_clocks(config, log)
    clocks = None
    if resolved.clocks is not None:
        clocks = Clocks(bus, config, resolved.clocks, master)
        clocks.measure()
    return ProcessData(resolved, image, wire, clocks)


def _warn_of_unused_clocks(config: Config, log: Log) -> None:
    if config.dc.slave and not config.dc.enabled:
        log.warning("dc.enabled is false, so the slaves in [[dc.slave]] get no SYNC signals")
    if config.dc.reference >= 0 and not config.dc.enabled:
        log.warning(f"dc.enabled is false, so dc.reference = {config.dc.reference} does nothing")
