// Bits of a signal as signals of their own: NAME.BIT, such as `4/0x6041:00.3`.
import type { Column, Signal } from "../protocol";

export interface Bit {
  source: string;
  bit: number;
}

/** CiA 402-2, statusword and controlword, by the first index of an axis. */
const NAMES: Record<number, string[]> = {
  0x6041: [
    "Ready to switch on", "Switched on", "Operation enabled", "Fault", "Voltage enabled", "Quick stop (low active)",
    "Switch on disabled", "Warning", "Bit 8", "Remote", "Target reached", "Internal limit active",
  ],
  0x6040: ["Switch on", "Enable voltage", "Quick stop (low active)", "Enable operation", "Bit 4", "Bit 5", "Bit 6", "Fault reset", "Halt"],
};
/** Distance of the objects of two axes of a drive. */
const AXIS = 0x800;

function bitName({ address }: Signal, bit: number): string {
  const index = parseInt(address, 16);
  const first = index >= 0x6000 && index < 0x6000 + 8 * AXIS ? 0x6000 + (index - 0x6000) % AXIS : 0;
  return NAMES[first]?.[bit] ?? `Bit ${bit}`;
}

/** Names of the bits of a signal; none if it is a number rather than bits. */
export function bitNames(signal: Signal): string[] {
  const isWhole = signal.type.includes("int") && signal.scale === 1 && signal.offset === 0;
  if (!isWhole || signal.bits < 2) return [];
  return Array.from({ length: signal.bits }, (_, bit) => bitName(signal, bit));
}

/** The bit that a name means, if it means one. */
export function bitOf(name: string): Bit | null {
  const match = /^(.+)\.(\d{1,2})$/.exec(name);
  return match ? { source: match[1]!, bit: Number(match[2]) } : null;
}

/** A signal of the bus, or a bit of one. */
export function find(known: ReadonlyMap<string, Signal>, name: string): Signal | undefined {
  const signal = known.get(name);
  const bit = signal ? null : bitOf(name);
  const source = bit && known.get(bit.source);
  const text = source && bitNames(source)[bit!.bit];
  if (!text) return signal;
  return {
    ...source, name, label: `${source.label}/${text}`, path: `${source.path}.${bit!.bit}`, type: "uint8",
    bits: 1, values: {}, unit: "", minimum: null, maximum: null,
  };
}

/** The bit in raw values from `low` to `high`: its least and its greatest value. */
export function bitIn(low: Column[number], high: Column[number], bit: number): [number, number] {
  if (!Number.isFinite(Number(low)) || !Number.isFinite(Number(high))) return [NaN, NaN];
  const shift = (value: Column[number]) => BigInt(value) >> BigInt(bit);
  if (typeof low === "number" && low === high && bit < 32 && Math.abs(low) < 2 ** 32) {
    const value = (low >> bit) & 1;
    return [value, value];
  }
  const [a, b] = [shift(low), shift(high)];
  return a === b ? [Number(a & 1n), Number(a & 1n)] : [0, 1];
}
