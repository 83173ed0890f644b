// Files of the samples: CSV and MCAP, with the columns of `ecatctl record`.
import type { Curve } from "./messages";
import { Mcap } from "./mcap";
import { BLOCK, VALID } from "./pyramid";
import { MINMAX, type Ring } from "./ring";

/** Rows between pauses, in which new samples are taken. */
const ROWS = 5000;

/** One row of a file. A place for several cycles makes two: least and greatest values. */
interface Row {
  cycle: number;
  /** Unix time in ms. */
  time: number;
  /** As JSON; null: unknown or old. */
  cells: (string | null)[];
  note: string;
}

function* rowsOf(ring: Ring, curves: Curve[], row: number): Generator<Row> {
  const block = ring.block(row);
  const at = row % BLOCK;
  const isMinmax = (block.flags[at]! & MINMAX) !== 0;
  const first = block.cycles[at]!;
  const last = block.lastCycle(at);
  for (const upper of isMinmax ? [false, true] : [false]) {
    const cells = curves.map(({ name, scale, offset }) => {
      const samples = block.columns.get(name);
      if (!samples || samples.flags[at] !== VALID) return null;
      const values = upper ? samples.upper ?? samples.values : samples.values;
      return cell(values[at]!, scale, offset);
    });
    const note = isMinmax ? `${upper ? "greatest" : "least"} value of cycles ${first} to ${last}` : "";
    yield { cycle: upper ? last : first, time: block.times[at]!, cells, note };
  }
}

/** Integers without a scale stay exact. */
function cell(raw: number | bigint, scale: number, offset: number): string | null {
  if (scale === 1 && offset === 0 && typeof raw === "bigint") return String(raw);
  const value = Number(raw) * scale + offset;
  return Number.isFinite(value) ? String(Number(value.toPrecision(15))) : null;
}

async function each(
  ring: Ring, curves: Curve[], from: number, to: number, take: (row: Row) => void,
): Promise<void> {
  for (let row = from; row < to; row++) {
    if (row < ring.first) continue; // it went meanwhile
    for (const each of rowsOf(ring, curves, row)) take(each);
    if (row % ROWS === 0) await new Promise((go) => setTimeout(go));
  }
}

const quote = (text: string) => (/[",\n\r]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);

/** ISO 8601 in UTC with microseconds. */
function utc(time: number): string {
  const whole = new Date(Math.floor(time)).toISOString().slice(0, -1);
  return `${whole}${String(Math.floor((time % 1) * 1000)).padStart(3, "0")}Z`;
}

export async function csv(ring: Ring, curves: Curve[], from: number, to: number): Promise<Blob> {
  const titles = curves.map(({ name, unit }) => quote(unit ? `${name} [${unit}]` : name));
  const last = ring.minmax ? ["utc", "note"] : ["utc"];
  const parts: Blob[] = [];
  let text = `${["time_s", "cycle", ...titles, ...last].join(",")}\r\n`;
  const start = from < to ? ring.time(from) : 0;
  await each(ring, curves, from, to, ({ cycle, time, cells, note }) => {
    const seconds = ((time - start) / 1000).toFixed(6);
    const end = ring.minmax ? `,${note}` : "";
    text += `${seconds},${cycle},${cells.map((each) => each ?? "").join(",")},${utc(time)}${end}\r\n`;
    if (text.length > 1 << 20) {
      parts.push(new Blob([text]));
      text = "";
    }
  });
  return new Blob([...parts, text], { type: "text/csv" });
}

export async function mcap(
  ring: Ring, curves: Curve[], from: number, to: number, bus: string,
): Promise<Blob> {
  const values = Object.fromEntries(
    curves.map(({ name, unit }) => [name, { type: ["number", "null"], description: unit }]),
  );
  const file = new Mcap(`/${bus}`, "ecatd.cycle", {
    type: "object",
    properties: { cycle: { type: "integer" }, values: { type: "object", properties: values } },
  });
  const names = curves.map(({ name }) => JSON.stringify(name));
  await each(ring, curves, from, to, ({ cycle, time, cells, note }) => {
    const all = names.map((name, i) => `${name}:${cells[i] ?? "null"}`).join(",");
    const more = note && `,"note":${JSON.stringify(note)}`;
    const ns = BigInt(Math.floor(time)) * 1_000_000n + BigInt(Math.round((time % 1) * 1e6));
    file.add(ns, cycle, `{"cycle":${cycle},"values":{${all}}${more}}`);
  });
  return file.end();
}
