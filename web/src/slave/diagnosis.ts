// Messages of the diagnosis history (object 0x10F3, ETG.1020), without texts of an ESI file.
import { clock, hex } from "../text";

export interface DiagnosisMessage {
  kind: string;
  when: string;
  text: string;
}

const FIRST = 6;
const KINDS = ["info", "warning", "error"];
const EPOCH_S = Date.UTC(2000, 0, 1) / 1000;
const FIRST_YEAR_S = 365 * 86400;

/** Subindices of all places for messages, the newest one first. */
export function places(newest: number, most: number): number[] {
  const all = Array.from({ length: most }, (_, at) => FIRST + at);
  const at = all.indexOf(newest) + 1;
  return [...all.slice(at), ...all.slice(0, at)].reverse();
}

/** A message; null for an empty place. */
export function parseMessage(bytes: Uint8Array): DiagnosisMessage | null {
  if (bytes.every((byte) => byte === 0)) return null;
  if (bytes.length < 16) return { kind: "warning", when: "", text: `a message of ${bytes.length} bytes is too short` };
  const view = new DataView(bytes.buffer);
  const code = view.getUint32(0, true), flags = view.getUint16(4, true), text = view.getUint16(6, true);
  const seconds = Number(view.getBigUint64(8, true)) / 1e9;
  const local = (flags & 0x10) !== 0 || seconds < FIRST_YEAR_S;
  const number = code >>> 16, low = code & 0xffff;
  const words = low === 0xe800 ? `Emergency ${hex(number, 4)}`
    : low >= 0xe000 && low < 0xe800 ? `Code ${hex(number, 4)} of the manufacturer` : `Diagnosis code ${hex(code, 8)}`;
  return {
    kind: KINDS[flags & 15] ?? "notice",
    when: local ? `${seconds.toFixed(3)} s` : clock(EPOCH_S + seconds, true),
    text: text === 0 ? words : `${words}, text ${hex(text, 4)} of its ESI file`,
  };
}
