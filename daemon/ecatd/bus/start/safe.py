"""Safe values of outputs, from the configuration to the bytes that the engine applies."""

from __future__ import annotations

from ecatd.model.bus import Bus, Slave
from ecatd.model.config import SafeConfig
from ecatd.model.datatypes import is_real, is_signed, value_range
from ecatd.model.errors import ConfigError


def safe_images(bus: Bus, rules: list[SafeConfig]) -> dict[int, tuple[bytes, bytes]]:
    """Value and hold mask for every slave with outputs (zero and no hold without a rule).

    Raises:
        ConfigError: A rule names a slave, an entry or a value that this bus does not have.
    """
    values = {slave.position: 0 for slave in bus.slaves if slave.output_bytes}
    holds = dict.fromkeys(values, 0)
    for rule in rules:
        if rule.slave >= len(bus.slaves):
            raise ConfigError(
                f"outputs.safe: there is no slave {rule.slave}: bus '{bus.name}' has "
                f"{len(bus.slaves)}"
            )
        if rule.slave not in values:
            raise ConfigError(f"outputs.safe: {bus.slaves[rule.slave].label} has no outputs")
        slave = bus.slaves[rule.slave]
        bit, bits = _place(slave, rule)
        mask = ((1 << bits) - 1) << bit
        values[rule.slave] &= ~mask
        holds[rule.slave] &= ~mask
        if rule.value == "hold":
            holds[rule.slave] |= mask
        elif isinstance(rule.value, int):
            values[rule.slave] |= (rule.value & ((1 << bits) - 1)) << bit
    return {
        position: (
            values[position].to_bytes(bus.slaves[position].output_bytes, "little"),
            holds[position].to_bytes(bus.slaves[position].output_bytes, "little"),
        )
        for position in values
    }


def _place(slave: Slave, rule: SafeConfig) -> tuple[int, int]:
    """First bit and number of bits that a rule is about, within the slave's outputs."""
    if rule.address is None:
        return 0, 8 * slave.output_bytes
    for _pdo, entry, bit in slave.entries(outputs=True):
        if (entry.index, entry.subindex) != rule.address:
            continue
        if isinstance(rule.value, int):
            if is_real(entry.data_type):
                raise ConfigError(
                    f"outputs.safe: {entry.address} of {slave.label} is a floating-point number; "
                    f'only "zero" and "hold" are possible'
                )
            low, high = value_range(entry.data_type, entry.bit_length)
            if not low <= rule.value <= high:
                raise ConfigError(
                    f"outputs.safe: {rule.value} is out of range for {entry.address} of "
                    f"{slave.label}: {low} to {high} are allowed"
                    + ("" if is_signed(entry.data_type) else " (it is unsigned)")
                )
        return bit, entry.bit_length
    raise ConfigError(f"outputs.safe: {slave.label} has no output {rule.entry}")
