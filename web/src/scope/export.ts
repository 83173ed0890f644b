// Files of the samples: CSV and MCAP, with the columns of `ecatctl record`.
import type { Curve } from "./messages";
import { Mcap } from "./mcap";
import { BLOCK, OLD } from "./pyramid";
import { MINMAX, type Ring } from "./ring";

/** Rows between pauses, in which new samples are taken. */
const ROWS = 5000;

/** One row of a file. A place for several cycles makes two: least and greatest values. */
interface Row {
  cycle: number;
  /** Unix time in ms. */
  time: number;
  /** Physical; null: unknown or old. */
  cells: (number | bigint | null)[];
  note: string;
}

function* rowsOf(ring: Ring, curves: Curve[], row: number): Generator<Row> {
  const block = ring.block(row);
  const at = row % BLOCK;
  const isMinmax = (block.flags[at]! & MINMAX) !== 0;
  const first = block.cycles[at]!;
  const last = block.lastCycle(at);
  for (const upper of isMinmax ? [false, true] : [false]) {
    const cells = curves.map(({ name, recorded: { scale, offset } }) => {
      const samples = block.columns.get(name);
      const flags = samples?.flags[at] ?? 0;
      if (!samples || flags === 0 || flags & OLD) return null;
      const raw = (upper ? samples.upper ?? samples.values : samples.values)[at]!;
      // Integers without a scale stay exact.
      return scale === 1 && offset === 0 ? raw : Number(raw) * scale + offset;
    });
    const note = isMinmax ? `${upper ? "greatest" : "least"} value of cycles ${first} to ${last}` : "";
    yield { cycle: upper ? last : first, time: block.times[at]!, cells, note };
  }
}

/** As `ecatctl record` writes it: 15 digits, or what is no number as Python calls it. */
function csvText(cell: number | bigint | null): string {
  if (cell === null) return "";
  if (typeof cell === "bigint" || Number.isInteger(cell)) return String(cell);
  if (Number.isFinite(cell)) return String(Number(cell.toPrecision(15)));
  return String(cell).toLowerCase().replace("infinity", "inf");
}

/** JSON has no infinity. */
const jsonText = (cell: number | bigint | null) =>
  typeof cell === "bigint" || Number.isFinite(cell) ? String(cell) : "null";

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
  const titles = curves.map(({ recorded: { path, unit } }) => quote(unit ? `${path} [${unit}]` : path));
  const last = ring.minmax ? ["utc", "note"] : ["utc"];
  const parts: Blob[] = [];
  let text = `${["time_s", "cycle", ...titles, ...last].join(",")}\r\n`;
  const start = from < to ? ring.time(from) : 0;
  await each(ring, curves, from, to, ({ cycle, time, cells, note }) => {
    const seconds = ((time - start) / 1000).toFixed(6);
    const end = ring.minmax ? `,${note}` : "";
    text += `${seconds},${cycle},${cells.map(csvText).join(",")},${utc(time)}${end}\r\n`;
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
    curves.map(({ recorded: { path, unit } }) => [
      path, { type: ["number", "null"], description: unit },
    ]),
  );
  const file = new Mcap(`/${bus}`, "ecatd.cycle", {
    type: "object",
    properties: { cycle: { type: "integer" }, values: { type: "object", properties: values } },
  });
  const names = curves.map(({ recorded }) => JSON.stringify(recorded.path));
  await each(ring, curves, from, to, ({ cycle, time, cells, note }) => {
    const all = names.map((name, i) => `${name}:${jsonText(cells[i]!)}`).join(",");
    const more = note && `,"note":${JSON.stringify(note)}`;
    const ns = BigInt(Math.floor(time)) * 1_000_000n + BigInt(Math.round((time % 1) * 1e6));
    file.add(ns, cycle, `{"cycle":${cycle},"values":{${all}}${more}}`);
  });
  return file.end();
}
