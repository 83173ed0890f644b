// What the scope computes, against brute force. Run by `npm test`.
import type { Batch, Column } from "../protocol";
import { csv } from "./export";
import type { Curve } from "./messages";
import { readLayout, writeLayout } from "./layout";
import { Extent } from "./pyramid";
import { eachColumn, rowsOf } from "./draw";
import { GAP, Ring } from "./ring";
import { search } from "./search";
import { spectrum, WINDOW_FUNCTIONS } from "./spectrum";
import { statistics } from "./statistics";
import { Finder, type Trigger } from "./trigger";

// Node's own modules, without a package of their types.
const load = (name: string): Promise<any> => import(name);
const { test } = await load("node:test");
const { default: assert } = await load("node:assert/strict");

let seed = 1;
function random(): number {
  seed = (Math.imul(seed, 1664525) + 1013904223) >>> 0;
  return seed / 2 ** 32;
}

function batchOf(cycles: number[], columns: Record<string, Column>, more: Partial<Batch> = {}): Batch {
  return {
    generation: 1, kind: "raw", cycles: Float64Array.from(cycles), lastCycles: null,
    times: Float64Array.from(cycles, (cycle) => 1.7e12 + cycle), invalid: new Map(), lost: false,
    columns: new Map(Object.entries(columns).map(([name, values]) => [name, { values }])), ...more,
  };
}

const KEEP = { time: 6e5, bytes: 1e9 };

/** A ring of 20 000 random cycles with gaps, and what is in it. */
function filled() {
  const ring = new Ring(KEEP);
  const cycles: number[] = [];
  const values: number[] = [];
  let cycle = 5;
  while (cycles.length < 20_000) {
    const part = Array.from({ length: 1 + Math.floor(random() * 90) }, () => (random() < 0.01 ? (cycle += 7) : ++cycle));
    const column = Int16Array.from(part, () => (random() - 0.5) * (random() < 0.001 ? 60_000 : 2000));
    ring.take(batchOf(part, { a: column }));
    cycles.push(...part);
    values.push(...column);
  }
  return { ring, cycles, values };
}

test("least and greatest values of any rows are those of brute force", () => {
  const { ring, values } = filled();
  for (let i = 0; i < 400; i++) {
    const from = Math.floor(random() * values.length);
    const to = from + 1 + Math.floor(random() ** 3 * (values.length - from));
    const extent = new Extent();
    ring.extent("a", from, Math.min(to, values.length), extent);
    const part = values.slice(from, to);
    assert.deepEqual([extent.min, extent.max], [Math.min(...part), Math.max(...part)]);
  }
});

test("columns of a picture lose no peak, and hold values over no gap", () => {
  const { ring, cycles, values } = filled();
  for (const step of [0.4, 1, 3.7, 60, 400]) {
    const count = 300;
    const from = Math.floor((1.7e12 + cycles[3000]!) / step);
    const rows = rowsOf(ring, { step, from, count });
    const shown = new Map<number, [number, number]>();
    eachColumn(ring, "a", rows, (column, min, max) => shown.set(column, [min, max]));
    for (let column = 0; column < count; column++) {
      const inside = cycles.flatMap((cycle, i) => {
        const time = 1.7e12 + cycle;
        return time >= (from + column) * step && time < (from + column + 1) * step ? [i] : [];
      });
      const next = inside[0] ?? cycles.findIndex((cycle) => 1.7e12 + cycle >= (from + column) * step);
      if (next < 0) continue;
      const held = next > 0 && cycles[next - 1] === cycles[next]! - 1 ? [next - 1] : [];
      const all = [...held, ...inside].map((i) => values[i]!);
      assert.deepEqual(shown.get(column), all.length ? [Math.min(...all), Math.max(...all)] : undefined);
    }
  }
});

test("gaps, old values, restarts of the daemon and clocks that go back are kept apart", () => {
  const ring = new Ring(KEEP);
  ring.take(batchOf([1, 2, 5], { a: Int8Array.of(1, 2, 3) }, { invalid: new Map([["a", [1]]]) }));
  assert.equal(ring.missing, 2);
  assert.equal(ring.rowFlags(2) & GAP, GAP);
  const result = statistics(ring, "a", 0, 3);
  assert.deepEqual([result.count, result.old, result.missing, result.mean], [2, 1, 2, 2]);
  ring.take(batchOf([1, 2], { a: Int8Array.of(7, 8) }, { times: Float64Array.of(5, 6) }));
  assert.equal(ring.end, 5);
  assert.ok(ring.time(3) > ring.time(2) && ring.time(4) > ring.time(3));
  assert.equal(ring.rowFlags(3) & GAP, GAP);
  assert.equal(ring.missing, 2);
});

test("a signal that is added later gets the history of rows that are there", () => {
  const ring = new Ring(KEEP);
  ring.take(batchOf([1, 2, 3, 4], { a: Int8Array.of(1, 2, 3, 4) }));
  ring.take(batchOf([2, 3, 4, 5], { a: Int8Array.of(9, 9, 9, 5), b: BigInt64Array.of(2n ** 62n + 1n, 3n, 4n, 5n) }, { generation: 2 }));
  assert.equal(ring.end, 5);
  assert.equal(ring.flags("b", 0), 0);
  assert.equal(ring.samples("b", 1)!.values[1], 2n ** 62n + 1n);
  assert.equal(ring.samples("a", 1)!.values[1], 2);
});

test("the ring keeps to its limits, and counts its bytes", () => {
  const ring = new Ring({ time: 20_000, bytes: 1e9 });
  for (let cycle = 0; cycle < 60_000; cycle += 500) {
    ring.take(batchOf(Array.from({ length: 500 }, (_, i) => cycle + i), { a: new Float32Array(500) }));
  }
  const kept = ring.end - ring.first;
  assert.ok(kept >= 20_000 && kept < 30_000, String(kept));
  const small = new Ring({ time: 6e5, bytes: 400_000 });
  for (let cycle = 0; cycle < 60_000; cycle += 500) {
    small.take(batchOf(Array.from({ length: 500 }, (_, i) => cycle + i), { a: new Float32Array(500) }));
  }
  assert.ok(small.short && small.bytes < 700_000);
  small.keep(new Set());
  let bytes = 0;
  for (let row = small.first; row < small.end; row += 4096) bytes += small.block(row).bytes;
  assert.equal(small.bytes, bytes);
});

test("places of least and greatest values are exact, also for a place without any", () => {
  const ring = new Ring(KEEP, new Map([["a", "int64"]]));
  const columns: Batch["columns"] = new Map([["a", { min: Float64Array.of(-3, NaN), max: Float64Array.of(9, NaN) }]]);
  ring.take(batchOf([1, 11], {}, { kind: "minmax", columns, lastCycles: Float64Array.of(10, 20), invalid: new Map([["a", [1]]]) }));
  const extent = new Extent();
  ring.extent("a", 0, 2, extent);
  assert.deepEqual([extent.min, extent.max, ring.missing], [-3, 9, 0]);
});

test("statistics are those of brute force", () => {
  const { ring, values } = filled();
  for (const [from, to] of [[0, 20_000], [17, 4096], [4096, 8192], [5000, 18_001]] as const) {
    const part = values.slice(from, to).map((value) => value * -0.5 + 3);
    const mean = part.reduce((a, b) => a + b) / part.length;
    const square = part.reduce((a, b) => a + b * b, 0) / part.length;
    const found = statistics(ring, "a", from, to, -0.5, 3);
    const wanted = [part.length, Math.min(...part), Math.max(...part)];
    assert.deepEqual([found.count, found.min, found.max], wanted);
    for (const [a, b] of [[found.mean, mean], [found.rms, Math.sqrt(square)], [found.deviation, Math.sqrt(square - mean * mean)]] as const) {
      assert.ok(Math.abs(a - b) < 1e-6 * Math.max(1, Math.abs(b)), `${a} ${b}`);
    }
  }
});

test("a spectrum shows sines at their frequency with their amplitude", () => {
  for (const window of WINDOW_FUNCTIONS) {
    const samples = Float64Array.from({ length: 4096 }, (_, i) => 7 + 2 * Math.sin((2 * Math.PI * 125 * i) / 1000) + 0.5 * Math.sin((2 * Math.PI * 31.25 * i) / 1000));
    const { peaks, amplitudes } = spectrum(samples, 1000, window);
    assert.ok(Math.abs(amplitudes[0]! - 7) < 1e-9);
    assert.ok(Math.abs(peaks[0]!.frequency - 125) < 0.02, window);
    assert.ok(Math.abs(peaks[0]!.amplitude - 2) < 1e-3, window);
    assert.ok(peaks.some(({ frequency, amplitude }) => Math.abs(frequency - 31.25) < 0.05 && Math.abs(amplitude - 0.5) < 1e-3), window);
  }
});

test("triggers fire in the cycle that fulfils the condition", () => {
  const ring = new Ring(KEEP);
  ring.take(batchOf([1, 2, 3, 4, 5, 6, 7, 8], { a: Int16Array.of(0, 5, 12, 12, 3, -20, 0, 30) }));
  const find = (change: Partial<Trigger>, from = 0) =>
    new Finder({ kind: "edge", source: "a", level: 10, upper: 0, slope: "rising", before: 0.5, mode: "normal", ...change }, 1, 0).find(ring, from, ring.end);
  assert.equal(find({}), 2);
  assert.equal(find({}, 3), 7);
  assert.equal(find({ slope: "falling" }), 4);
  assert.equal(find({ kind: "level", level: 30 }), 7);
  assert.equal(find({ kind: "level", level: -5, slope: "falling" }), 5);
  assert.equal(find({ kind: "window", level: -10, upper: 20 }), 5);
  assert.equal(find({ kind: "window", level: -10, upper: 20, slope: "falling" }), 6);
  assert.equal(find({ level: 99 }), -1);
});

test("hostile layouts are refused with the place of what is wrong", () => {
  const good = { signals: [{ name: "1/0x6000:01", colour: 1, axis: "", gain: 1, hidden: false }], stacked: false, limits: { "unit V": [0, 1] as [number, number] }, span: 500, trigger: null };
  assert.deepEqual({ ...readLayout(writeLayout(good)), limits: good.limits }, good);
  const head = '"format":"ecatd scope layout","version":1';
  for (const [text, wrong] of [
    ["{", /no JSON/], ["[]", /object/], ["{}", /no layout/], [`{${head}}`, /signals/],
    [`{${head},"signals":[3]}`, /signals\[0\]/], [`{${head},"signals":[{"name":3}]}`, /name/],
    [`{${head},"signals":[{"name":"a","gain":"1"}]}`, /gain/], [`{${head},"signals":[],"span":-1}`, /span/],
    [`{${head},"signals":[],"limits":{"a":[2,1]}}`, /limits/],
    [`{${head},"signals":[],"trigger":{"kind":"evil","source":""}}`, /trigger.kind/],
    [" ".repeat(2e6), /too long/],
  ] as const) assert.throws(() => readLayout(text), wrong);
  const polluted = readLayout(`{${head},"signals":[],"limits":{"__proto__":[0,1]}}`);
  assert.equal(({} as Record<string, unknown>)[0], undefined);
  assert.ok(polluted);
});

test("search prefers whole words, and finds letters in order", () => {
  const of = (label: string) => ({ label, name: label, unit: "" }) as never;
  const all = ["Drive/Position demand", "Drive/Position actual value", "EL3008/Value"].map(of);
  assert.equal(search(all, "pos act", 9)[0]!.label, "Drive/Position actual value");
  assert.equal(search(all, "zzz", 9).length, 0);
});

test("CSV files have the columns of a recording, and integers exact", async () => {
  const ring = new Ring(KEEP);
  ring.take(batchOf([1, 3], { a: BigInt64Array.of(2n ** 60n + 1n, -1n) }, { invalid: new Map([["a", [1]]]) }));
  const curve = { name: "a", unit: "V", scale: 1, offset: 0 } as Curve;
  const lines = (await (await csv(ring, [curve], 0, 2)).text()).split("\r\n");
  assert.equal(lines[0], "time_s,cycle,a [V],utc");
  assert.ok(lines[1]!.startsWith("0.000000,1,1152921504606846977,2023-11-14T"));
  assert.ok(lines[2]!.startsWith("0.002000,3,,"));
});
