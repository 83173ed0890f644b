// The parts of the page that compute: how the bus is wired, and differences of histograms.
import { columns, difference, marksOf, quantile } from "./histogram";
import type { Bucket, Bus, Errors } from "./maps";
import { places } from "./slave/diagnosis";
import { decoded } from "./slave/coe";
import { microseconds, physical } from "./text";
import { plugs, rows } from "./topology/wire";

// Node's own modules, without a package of their types.
const load = (name: string): Promise<any> => import(name);
const { test } = await load("node:test");
const { default: assert } = await load("node:assert/strict");

const busOf = (count: number) =>
  ({ slaves: Array.from({ length: count }, (_, position) => ({ position })) }) as unknown as Bus;
const port = (number: number, to: [number, number] | null) =>
  ({ port: number, invalid: 0, physical: 0, forwarded: 0, lost_links: 0, to });
// A junction: port 3 leads to slave 2, port 1 to slave 4; slave 1 is a line before it.
const BRANCHES = {
  slaves: [
    { position: 0, ports: [port(0, [-1, 0]), port(1, [1, 0])] },
    { position: 1, ports: [port(0, [0, 1]), port(3, [2, 0]), port(1, [4, 0])] },
    { position: 2, ports: [port(0, [1, 3]), port(1, [3, 0])] },
    { position: 3, ports: [port(0, [2, 1])] },
    { position: 4, ports: [port(0, [1, 1])] },
  ],
} as unknown as Errors;

test("branches are indented, and the last slave goes on in the line", () => {
  const found = rows(busOf(5), BRANCHES, new Map());
  assert.deepEqual(found.map((row) => [row.slave, row.depth, row.before, row.port]),
    [[0, 0, -1, null], [1, 0, 0, 1], [2, 1, 1, 3], [3, 1, 2, 1], [4, 0, 1, 1]]);
});

test("a slave that does not answer stays where it was", () => {
  const remembered = plugs(BRANCHES);
  const now = structuredClone(BRANCHES);
  now.slaves.splice(3, 1);
  now.slaves[2]!.ports[1]!.to = null;
  const lost = rows(busOf(5), now, remembered)[3]!;
  assert.deepEqual([lost.slave, lost.before, lost.gone], [3, 2, true]);
  now.links = [{ slave: 3, port: 0, before: 2, before_port: 1, verdict: "bad", text: "no link now" }];
  const told = rows(busOf(5), now, new Map())[3]!; // also in a page that was opened afterwards
  assert.deepEqual([told.slave, told.before, told.gone, told.verdict], [3, 2, true, "bad"]);
  const unknown = rows(busOf(5), null, new Map());
  assert.ok(unknown.every((row) => row.before === null && !row.gone));
});

test("while a ring is open, nobody says what ports lead to, and yet no cable is gone", () => {
  const open = structuredClone(BRANCHES);
  for (const { ports } of open.slaves) for (const each of ports) each.to = null;
  const found = rows(busOf(5), open, plugs(BRANCHES));
  assert.deepEqual(found.map((row) => [row.before, row.gone]), [[-1, false], [0, false], [1, false], [2, false], [1, false]]);
});

test("200 slaves in a line are one column", () => {
  const line = { slaves: busOf(200).slaves.map(({ position }) => ({ position, ports: [port(0, [position - 1, 1]), port(1, position < 199 ? [position + 1, 0] : null)] })) };
  const found = rows(busOf(200), line as unknown as Errors, new Map());
  assert.deepEqual(found.map((row) => row.slave), busOf(200).slaves.map((slave) => slave.position));
  assert.ok(found.every((row) => row.depth === 0));
});

test("the difference of two readings is what came between them", () => {
  const before: Bucket[] = [[1, 2, 10], [2, 4, 5]];
  const now: Bucket[] = [[1, 2, 10], [2, 4, 8], [4, 8, 1]];
  assert.deepEqual(difference(now, before), [[2, 4, 3], [4, 8, 1]]);
  assert.deepEqual(difference(before, now), before); // it began anew
  assert.deepEqual(marksOf(difference(now, before)), { count: 4, p50: 4, p99: 8, p999: 8, max: 8 });
  assert.equal(quantile([], 0.5), undefined);
});

test("columns keep the number of samples", () => {
  const buckets: Bucket[] = [[1, 3, 7], [90, 110, 2], [5000, 6000, 1]];
  const sum = columns(buckets, 1, 10000, 40).reduce((a, b) => a + b, 0);
  assert.ok(Math.abs(sum - 10) < 1e-6);
});

test("values are shown as people read them", () => {
  assert.equal(decoded("feff", 0x03), "-2");
  assert.equal(decoded("9a000000", 0x07), "154 (0x0000009A)");
  assert.equal(decoded("454c3330303800", 0x09), "EL3008");
  assert.equal(decoded("d204", 0x03, 0.01, 0, "V"), "12.34 V");
  assert.equal(physical(-0.5, 0.125), "−0.5");
  assert.equal(microseconds(1234), "1.23\u202fms");
  assert.deepEqual(places(7, 3), [7, 6, 8]);
});
