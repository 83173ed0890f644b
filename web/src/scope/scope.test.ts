// What the scope computes, against brute force. Run by `npm test`.
import type { Batch, Column, Signal } from "../protocol";
import { timeTicks, tickTexts } from "./axes";
import { bitNames, find } from "./bits";
import { colours, dash, isGap, LOOKS } from "./colours";
import { csv, mcap } from "./export";
import type { Curve } from "./messages";
import { readLayout, writeLayout } from "./layout";
import { Extent } from "./pyramid";
import { eachColumn, rowsOf } from "./draw";
import { GAP, PAUSE, Ring } from "./ring";
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

test("times that jitter are put in order; a clock that is set back moves those that follow", () => {
  const ring = new Ring(KEEP);
  const at = (cycle: number, ms: number) => ring.take(batchOf([cycle], { a: Int8Array.of(1) }, { times: Float64Array.of(1.7e12 + ms) }));
  at(1, 100);
  at(2, 60);
  at(3, 102);
  assert.deepEqual([ring.time(1) - ring.time(0) < 0.01, ring.time(2), ring.shift], [true, 1.7e12 + 102, 0]);
  at(4, -3_600_000);
  at(5, -3_599_999);
  assert.ok(Math.abs(ring.time(4) - ring.time(3) - 1) < 0.001 && ring.shift > 3.6e6);
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

test("the history of a first signal counts, also if a second one was chosen meanwhile", () => {
  const ring = new Ring(KEEP);
  ring.keep(["a"], 1);
  ring.take(batchOf([7], { a: Int8Array.of(7), b: Int8Array.of(7) }, { generation: 0 })); // of a panel
  ring.take(batchOf([1, 2], { a: Int8Array.of(1, 2) }, { kind: "history", generation: 1 }));
  ring.keep(["a", "b"], 2);
  ring.take(batchOf([7], { b: Int8Array.of(7) }, { generation: 1 })); // of that panel
  ring.take(batchOf([3], { a: Int8Array.of(3) }, { kind: "history", generation: 1 }));
  ring.take(batchOf([4], { a: Int8Array.of(4) }, { generation: 2 }));
  ring.take(batchOf([2, 3, 4], { b: Int8Array.of(2, 3, 4) }, { kind: "history", generation: 2 }));
  assert.deepEqual([ring.end, ring.samples("a", 0)!.values[0], ring.samples("b", 1)!.values[1]], [4, 1, 2]);
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

test("what came before the first place of several cycles keeps its values", () => {
  const ring = new Ring(KEEP, new Map([["a", "int16"]]));
  ring.take(batchOf([1, 2], { a: Int16Array.of(5, 6) }));
  const columns: Batch["columns"] = new Map([["a", { min: Float64Array.of(1), max: Float64Array.of(9) }]]);
  ring.take(batchOf([3], {}, { kind: "minmax", columns, lastCycles: Float64Array.of(9) }));
  assert.deepEqual([0, 1, 2].map((row) => ring.samples("a", row)!.high(row)), [5, 6, 9]);
  assert.deepEqual([statistics(ring, "a", 0, 2).min, statistics(ring, "a", 0, 2).mean], [5, 5.5]);
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

test("CSV and MCAP files have the columns of a recording, and values exact", async () => {
  const ring = new Ring(KEEP);
  ring.take(batchOf([1, 3, 4], {
    a: BigInt64Array.of(2n ** 60n + 1n, -1n, -(2n ** 63n)), b: Float32Array.of(0.1, NaN, -Infinity),
    c: Int16Array.of(-3, 7, 32767),
  }, { invalid: new Map([["a", [1]]]) }));
  const curves = [
    // The factor of the picture, 10, is not in files.
    { name: "a", unit: "× 10", scale: 10, offset: 0, recorded: { path: "1/Count, all", unit: "", scale: 1, offset: 0 } },
    { name: "b", unit: "V", scale: 1, offset: 0, recorded: { path: "1/Level", unit: "V", scale: 1, offset: 0 } },
    { name: "c", unit: "A", scale: 0.1, offset: 2, recorded: { path: "1/Current", unit: "A", scale: 0.1, offset: 2 } },
  ] as Curve[];
  const lines = (await (await csv(ring, curves, 0, 3)).text()).split("\r\n");
  assert.equal(lines[0], 'time_s,cycle,"1/Count, all",1/Level [V],1/Current [A],utc');
  assert.ok(lines[1]!.startsWith("0.000000,1,1152921504606846977,0.100000001490116,1.7,2023-11-14T"));
  assert.ok(lines[2]!.startsWith("0.002000,3,,nan,2.7,"));
  assert.ok(lines[3]!.startsWith("0.003000,4,-9223372036854775808,-inf,3278.7,"));
  const file = await (await mcap(ring, curves, 0, 3, "rig")).text();
  assert.ok(file.includes('{"cycle":1,"values":{"1/Count, all":1152921504606846977,"1/Level":0.10000000149011612,"1/Current":1.7}}'));
  assert.ok(file.includes('{"cycle":3,"values":{"1/Count, all":null,"1/Level":null,"1/Current":2.7}}'));
});

test("no peak is lost in windows of a ring that has wrapped, at any zoom", () => {
  const ring = new Ring({ time: 20_000, bytes: 1e9 });
  const values = Int32Array.from({ length: 90_000 }, () => (random() < 0.001 ? (random() - 0.5) * 1e9 : random() * 10));
  for (let from = 0; from < values.length; from += 50) {
    ring.take(batchOf(Array.from({ length: 50 }, (_, i) => from + i), { a: values.slice(from, from + 50) }));
  }
  assert.ok(ring.first > 60_000 && ring.first % 4096 === 0, "the oldest blocks went");
  for (const [span, count] of [[ring.end - ring.first, 700], [9000, 613], [1200, 640], [250, 500]] as const) {
    const step = span / count;
    const from = Math.ceil((1.7e12 + ring.end - span) / step) - 7;
    const rows = rowsOf(ring, { step, from, count });
    eachColumn(ring, "a", rows, (column, min, max) => {
      const [begin, end] = [column, column + 1].map((at) => Math.ceil((from + at) * step - 1.7e12 - 1e-6));
      const first = Math.max(ring.first, begin! - 1); // the value that is held
      const part = values.subarray(first, Math.max(Math.min(end!, ring.end), first + 1));
      assert.deepEqual([min, max], [Math.min(...part), Math.max(...part)], `${span} ${column}`);
    });
  }
});

test("a ring goes on over hours without cycles, restarts, and another type of a signal", () => {
  const ring = new Ring({ time: 864e5, bytes: 1e9 });
  const hours = 5 * 36e5;
  ring.take(batchOf([7, 8], { a: Int8Array.of(1, 2) }));
  // The daemon begins again hours later: its numbers do, too.
  ring.restart();
  ring.take(batchOf([1, 2], { a: Int8Array.of(3, 4) }, { times: Float64Array.of(1.7e12 + hours, 1.7e12 + hours + 1) }));
  assert.deepEqual([ring.end, ring.missing, ring.shift, ring.cycle(2)], [4, 0, 0, 1]);
  assert.equal(ring.rowAt(1.7e12 + 100), 2);
  const shown: number[] = [];
  eachColumn(ring, "a", rowsOf(ring, { step: hours / 100, from: Math.floor(1.7e12 / (hours / 100)), count: 102 }), (column) => shown.push(column));
  assert.ok(shown.length === 2 && shown[1]! - shown[0]! >= 99, "nothing is drawn where nothing was");
  ring.setTypes(new Map([["a", "int32"]]));
  ring.take(batchOf([3], { a: Int32Array.of(70_000) }, { times: Float64Array.of(1.7e12 + hours + 2) }));
  assert.equal(ring.samples("a", 4)!.values[4], 70_000);
  assert.equal(ring.flags("a", 0), 0);
});

test("a time without a recording is a pause; only what was lost meanwhile is missing", () => {
  const ring = new Ring(KEEP);
  const take = (cycles: number[], more: Partial<Batch>, name = "a") =>
    ring.take(batchOf(cycles, { [name]: new Int8Array(cycles.length) }, more));
  const seen = () => [ring.missing, ring.pauses, ring.end, ring.shift];
  ring.keep(["a"], 1);
  take([6000], { generation: 0 });
  take([1, 2, 3], {});
  take([9000], {}, "of a panel");
  take([5000, 5001], { kind: "history", generation: 2 });
  take([5002], { kind: "history", generation: 2 });
  take([5003], { generation: 2 });
  assert.deepEqual(seen(), [0, 1, 7, 0]);
  assert.equal(ring.rowFlags(3), GAP | PAUSE);
  take([5005], { generation: 2 });
  take([5008], { generation: 3, lost: true });
  assert.deepEqual(seen(), [3, 1, 9, 0]);
  ring.restart(); // the daemon was away
  take([8000], { generation: 3 });
  assert.deepEqual(seen(), [3, 2, 10, 0]);
  ring.clear();
  assert.deepEqual(seen(), [0, 0, 0, 0]);
  take([1, 2], {});
  assert.deepEqual([ring.end, ring.first, ring.cycle(0), ring.bytes === new Ring(KEEP).bytes], [2, 0, 1, false]);
});

const STATUSWORD: Signal = {
  name: "0/0x6041:00", label: "Drive/Statusword", path: "0/Statusword", slave: 0, address: "0x6041:00", output: false,
  type: "uint16", bits: 16, scale: 1, offset: 0, unit: "", minimum: null, maximum: null, values: {},
};

test("bits of a signal have lanes of their own, also of what was recorded before", () => {
  const known = new Map([[STATUSWORD.name, STATUSWORD]]);
  assert.equal(find(known, "0/0x6041:00.3")!.label, "Drive/Statusword/Fault");
  assert.equal(find(known, "0/0x6041:00.15")!.label, "Drive/Statusword/Bit 15");
  assert.equal(bitNames({ ...STATUSWORD, address: "0x6841:00" })[10], "Target reached");
  for (const name of ["0/0x6041:00.16", "9/0x6041:00.1", "0/0x6041:00."]) assert.equal(find(known, name), undefined);
  assert.deepEqual(bitNames({ ...STATUSWORD, type: "float32" }), []);
  const ring = new Ring(KEEP, new Map([[STATUSWORD.name, "uint16"], ["i", "int64"]]));
  ring.take(batchOf([1, 2], { [STATUSWORD.name]: Uint16Array.of(8, 0x8000), i: BigInt64Array.of(-1n, 2n ** 40n) }));
  const names = ["0/0x6041:00.3", "0/0x6041:00.15", "i.40"];
  ring.keep(names);
  const lastCycles = Float64Array.of(10, 20);
  ring.take(batchOf([3, 11], {}, {
    kind: "minmax", lastCycles,
    columns: new Map([[STATUSWORD.name, { min: Float64Array.of(8, 0), max: Float64Array.of(8, 9) }]]),
  }));
  const of = (name: string) => [0, 1, 2, 3].map((row) => [ring.samples(name, row)!.low(row), ring.samples(name, row)!.high(row)]);
  assert.deepEqual(of(names[0]!), [[1, 1], [0, 0], [1, 1], [0, 1]]);
  assert.deepEqual(of(names[1]!), [[0, 0], [1, 1], [0, 0], [0, 0]]);
  assert.deepEqual([ring.samples("i.40", 0)!.low(0), ring.samples("i.40", 1)!.low(1), ring.flags("i.40", 2)], [1, 1, 0]);
  ring.keep([]);
  assert.equal(ring.samples(STATUSWORD.name, 0), undefined);
});

test("what is no number is not drawn, and shows no peak", () => {
  const ring = new Ring(KEEP);
  ring.take(batchOf([1, 2, 3, 4], { a: Float64Array.of(NaN, 5, Infinity, -Infinity) }));
  const extent = new Extent();
  ring.extent("a", 0, 4, extent);
  assert.deepEqual([extent.min, extent.max], [5, 5]);
  const shown: number[][] = [];
  eachColumn(ring, "a", rowsOf(ring, { step: 1, from: 1.7e12 + 1, count: 4 }), (column, min, max) => shown.push([column, min, max]));
  assert.deepEqual(shown.filter(([column]) => column !== 2), [[1, 5, 5]]);
});

test("ticks of counters keep their digits, and times of days are whole", () => {
  const { base, texts } = tickTexts([9007199254740000, 9007199254745000, 9007199254750000]);
  assert.deepEqual([base, texts], [9007199254740000, ["+0", "+5000", "+10000"]]);
  assert.deepEqual(tickTexts([-0.5, 0, 0.5]).texts, ["-0.5", "0", "0.5"]);
  assert.ok(timeTicks(1.7e12, 3 * 864e5, 8).times.length < 12);
});

test("a word of 199 slaves is found", () => {
  const all = Array.from({ length: 199 }, (_, slave) => ["Statusword", "Position actual value", "Torque"].map((text, i) => (
    { ...STATUSWORD, name: `${slave}/0x60${41 + i}:00`, label: `Drive ${slave}/${text}` }
  ))).flat();
  for (const [query, label] of [["57/stat", "Drive 57/Statusword"], ["drive 7 torque", "Drive 7/Torque"], ["198/0x6041", "Drive 198/Statusword"]] as const) {
    assert.equal(search(all, query, 12)[0]!.label, label);
  }
});

/** Linear sRGB as people see it who lack a kind of cones (Machado, Oliveira, Fernandes 2009). */
const EYES = {
  all: [1, 0, 0, 0, 1, 0, 0, 0, 1],
  "no red": [0.152286, 1.052583, -0.204868, 0.114503, 0.786281, 0.099216, -0.003882, -0.048116, 1.051998],
  "no green": [0.367322, 0.860646, -0.227968, 0.280085, 0.672501, 0.047413, -0.01182, 0.04294, 0.968881],
  "no blue": [1.255528, -0.076749, -0.178779, -0.078411, 0.930809, 0.147602, 0.004733, 0.691367, 0.3039],
};
const times = (matrix: number[], [x, y, z]: number[]) =>
  [0, 3, 6].map((row) => matrix[row]! * x! + matrix[row + 1]! * y! + matrix[row + 2]! * z!);

function linear(hex: string): number[] {
  return [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255)
    .map((part) => (part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4));
}

/** Björn Ottosson (2020): places whose distance is that of what people see. */
function oklab(rgb: number[]): number[] {
  const cones = times([0.4122214708, 0.5363325363, 0.0514459929, 0.2119034982, 0.6806995451, 0.1073969566, 0.0883024619, 0.2817188376, 0.6299787005], rgb);
  return times([0.2104542553, 0.793617785, -0.0040720468, 1.9779984951, -2.428592205, 0.4505937099, 0.0259040371, 0.7827717662, -0.808675766], cones.map((each) => Math.cbrt(Math.max(0, each))));
}

test("curves differ for colour-blind people too, by day and by night", () => {
  const light = (hex: string) => linear(hex).reduce((sum, part, i) => sum + part * [0.2126, 0.7152, 0.0722][i]!, 0);
  for (const [dark, background] of [[false, "#ffffff"], [true, "#1b1f23"]] as const) {
    const all = colours(dark);
    for (const each of all) {
      const [a, b] = [light(each), light(background)].sort((x, y) => y - x);
      assert.ok((a! + 0.05) / (b! + 0.05) >= 2.95, `${each} on ${background}`);
    }
    for (const [eyes, matrix] of Object.entries(EYES)) {
      const seen = all.map((each) => oklab(times(matrix, linear(each)).map((part) => Math.min(1, Math.max(0, part)))));
      seen.forEach((one, i) => seen.slice(0, i).forEach((other, j) => {
        const distance = Math.hypot(...one.map((part, k) => part - other[k]!));
        assert.ok(distance > 0.13, `${all[i]} and ${all[j]} for ${eyes}: ${distance}`);
      }));
    }
  }
  assert.equal(new Set(Array.from({ length: LOOKS }, (_, i) => `${i % colours(true).length} ${dash(i)}`)).size, LOOKS);
  assert.deepEqual([6, 7, 10, 11].map((place) => isGap([7, 4], place)), [false, true, true, false]);
});
