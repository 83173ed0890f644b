// Values of objects (ETG.1000.6): bytes into what people read.
import { hex, physical } from "../text";

const NUMBERS: Record<number, [bits: number, kind: "signed" | "unsigned" | "float"]> = {
  0x02: [8, "signed"], 0x03: [16, "signed"], 0x10: [24, "signed"], 0x04: [32, "signed"], 0x15: [64, "signed"],
  0x05: [8, "unsigned"], 0x06: [16, "unsigned"], 0x16: [24, "unsigned"], 0x07: [32, "unsigned"], 0x1b: [64, "unsigned"],
  0x1e: [8, "unsigned"], 0x1f: [16, "unsigned"], 0x20: [32, "unsigned"],
  0x08: [32, "float"], 0x11: [64, "float"],
};
const NAMES: Record<number, string> = {
  0x01: "BOOL", 0x02: "INT8", 0x03: "INT16", 0x04: "INT32", 0x05: "UINT8", 0x06: "UINT16", 0x07: "UINT32", 0x08: "REAL32",
  0x09: "STRING", 0x0a: "OCTETS", 0x0b: "UNICODE", 0x10: "INT24", 0x11: "REAL64", 0x15: "INT64", 0x16: "UINT24",
  0x1b: "UINT64", 0x1e: "BYTE", 0x1f: "WORD", 0x20: "DWORD",
};
const READ = 0x07, WRITE = 0x38;

/** The number of a data type by its name, as the configuration has it: `uint32`; 0 if unknown. */
export function typeOf(name: string): number {
  const wanted = name.toUpperCase();
  return Number(Object.entries(NAMES).find(([, known]) => known === wanted)?.[0] ?? 0);
}

export function typeName(type: number): string {
  if (type >= 0x30 && type <= 0x37) return `BIT${type - 0x2f}`;
  return NAMES[type] ?? hex(type, 4);
}

export function bytesOf(data: string): Uint8Array {
  return Uint8Array.from(data.match(/../g) ?? [], (pair) => Number.parseInt(pair, 16));
}

export const readable = (access: number) => (access & READ) !== 0;
export const writable = (access: number) => (access & WRITE) !== 0;

/** A value as text; bytes in hexadecimal if its type says nothing. */
export function decoded(data: string, type: number, scale = 1, offset = 0, unit = ""): string {
  const bytes = bytesOf(data);
  const suffix = unit === "" || unit === "1" ? "" : ` ${unit}`;
  if (type === 0x01) return bytes[0] === 0 ? "false" : "true";
  if (type === 0x09) return new TextDecoder("latin1").decode(bytes).replace(/\0+$/, "");
  if (type === 0x0b) return new TextDecoder("utf-16le").decode(bytes).replace(/\0+$/, "");
  const number = NUMBERS[type];
  if (number === undefined || bytes.length * 8 !== number[0]) return data.match(/../g)?.join(" ") ?? "";
  const [bits, kind] = number;
  if (kind === "float") {
    const view = new DataView(bytes.buffer);
    const value = bits === 32 ? view.getFloat32(0, true) : view.getFloat64(0, true);
    return physical(value * scale + offset, 1) + suffix;
  }
  let raw = 0n;
  for (let at = bytes.length - 1; at >= 0; at -= 1) raw = (raw << 8n) | BigInt(bytes[at]!);
  if (kind === "signed") raw = BigInt.asIntN(bits, raw);
  if (scale !== 1 || offset !== 0) return physical(Number(raw) * scale + offset, scale) + suffix;
  const text = String(raw) + suffix;
  return kind === "unsigned" && bits >= 16 && raw > 9n ? `${text} (${hex(Number(raw), bits / 4)})` : text;
}
