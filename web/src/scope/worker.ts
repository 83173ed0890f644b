// The worker of the scope: keeps the samples, looks for triggers, and draws.
import { readBatch } from "../protocol";
import { Detail } from "./detail";
import { csv, mcap } from "./export";
import { counts, type Curve, type Look, type Order, type Reading, type Report, type Status } from "./messages";
import { Picture } from "./picture";
import { BLOCK, NO_NUMBER, OLD } from "./pyramid";
import { Ring } from "./ring";
import { statistics } from "./statistics";
import { Finder, type Trigger } from "./trigger";

const MINUTES = 10;
const LIVE_LIMITS = { time: MINUTES * 60e3, bytes: 256e6 };
const FILE_LIMITS = { time: Infinity, bytes: 1e9 };
/** ms between reports, the same while the user points at something, and between statistics. */
const REPORT = 100;
const REPORT_HOVER = 40;
const STATISTICS = 400;
/** ms after which "auto" shows what comes without a trigger, beside the window. */
const PATIENCE = 1000;

const ring = new Ring({ ...LIVE_LIMITS });
const picture = new Picture(ring);
const detail = new Detail();
let isDue = false;
let isFile = false;
let look: Look | null = null;
let wantsStatistics = false;
/** How many orders beside samples and pointers were obeyed, and how many of them the picture has. */
let obeyed = 0;
let drawn = 0;
let lastReport = 0;
let lastStatistics = 0;
let drawings: number[] = [];
let ends: number[] = [];

let trigger: Trigger | null = null;
/** When an incident was triggered. */
let moment: number | null = null;
let finder: Finder | null = null;
let state: Status["trigger"] = "off";
let searched = 0;
let firedAt = 0;
let shownAt = 0;

const post = (report: Report) => self.postMessage(report);

function due(): void {
  if (isDue) return;
  isDue = true;
  requestAnimationFrame(frame);
}

function frame(): void {
  isDue = false;
  drawn = obeyed;
  const begin = performance.now();
  picture.draw();
  const end = performance.now();
  drawings.push(end - begin);
  ends.push(end);
  if (drawings.length > 60) drawings = drawings.slice(-40);
  ends = ends.filter((at) => at > end - 1000);
  const pause = picture.hover === null ? REPORT : REPORT_HOVER;
  if (end - lastReport >= pause) report(end);
  else setTimeout(() => performance.now() - lastReport >= pause && report(performance.now()), pause);
}

function report(now: number): void {
  lastReport = now;
  const { view, plot, cursors } = picture;
  const rows = cursors.map((time) => rowOf(time));
  post({
    is: "status", view, left: plot.left, width: plot.width, lanes: plot.lanes,
    readings: picture.curves.map((curve) => [
      ring.end > 0 ? reading(curve, ring.end - 1) : NONE,
      ...rows.map((row) => (row < 0 ? NONE : reading(curve, row))),
    ]),
    cycles: rows.map((row) => (row < 0 ? NaN : ring.cycle(row))),
    hover: hovered(picture.hover),
    rows: ring.end - ring.first, first: ring.firstTime, last: ring.lastTime, bytes: ring.bytes,
    short: ring.short, missing: ring.missing, pauses: ring.pauses, minmax: ring.minmax, shift: ring.shift,
    trigger: state,
    drawing: drawings.reduce((sum, ms) => sum + ms, 0) / Math.max(1, drawings.length),
    frames: ends.length, drawn,
  });
  if (now - lastStatistics < STATISTICS || ring.end === 0) return;
  lastStatistics = now;
  const [from, to, span] = window();
  if (wantsStatistics) {
    const visible = picture.curves.filter((curve) => !curve.hidden);
    post({
      is: "statistics", span,
      rows: visible.map(({ name, scale, offset }) => ({
        name, ...statistics(ring, name, from, to, scale, offset),
      })),
    });
  }
  if (look) {
    const result = detail.draw(ring, look, picture.curves, from, to, picture.palette);
    if (result) post(result);
  }
}

/** Rows between the cursors, or else of the picture. */
function window(): [number, number, number] {
  const [a, b] = picture.cursors;
  const { start, span } = picture.view;
  const isBetween = a !== undefined && b !== undefined && a !== b;
  const begin = isBetween ? Math.min(a, b) : start;
  const end = isBetween ? Math.max(a, b) : start + span;
  return [ring.rowAt(begin), ring.rowAt(end), end - begin];
}

function hovered(time: number | null): Status["hover"] {
  const row = time === null || time > ring.lastTime ? -1 : rowOf(time);
  if (row < 0) return null;
  return {
    time: ring.time(row), cycle: ring.cycle(row),
    readings: picture.curves.map((curve) => reading(curve, row)),
  };
}

function step(cursor: number, cycles: number): void {
  const time = picture.cursors[cursor];
  if (time === undefined || ring.end === 0) return;
  const row = Math.max(ring.first, Math.min(ring.end - 1, Math.max(ring.first, rowOf(time)) + cycles));
  picture.cursors = picture.cursors.with(cursor, ring.time(row));
  post({ is: "cursors", cursors: picture.cursors });
}

/** The row that holds at a time, or -1. */
function rowOf(time: number): number {
  if (ring.end === 0 || time < ring.firstTime) return -1;
  const row = ring.rowAt(time);
  return row < ring.end && ring.time(row) === time ? row : row - 1;
}

const NONE: Reading = { value: null, name: "", old: false };

function reading({ name, scale, offset, values }: Curve, row: number): Reading {
  const samples = ring.samples(name, row);
  const at = row % BLOCK;
  const flags = samples?.flags[at] ?? 0;
  if (!samples || flags === 0) return NONE;
  const raw = samples.values[at]!;
  if (flags & NO_NUMBER && !samples.type.startsWith("float")) return NONE;
  const isExact = typeof raw === "bigint" && scale === 1 && offset === 0;
  return {
    value: isExact ? String(raw) : Number(raw) * scale + offset,
    name: values[String(raw)] ?? "",
    old: (flags & OLD) !== 0,
  };
}

function setTrigger(wanted: Trigger | null): void {
  trigger = wanted;
  const curve = picture.curves.find(({ name }) => name === trigger?.source);
  finder = trigger && curve && trigger.kind !== "event"
    ? new Finder(trigger, curve.scale, curve.offset) : null;
  state = trigger ? "waits" : "off";
  picture.trigger = moment;
  searched = ring.end;
  shownAt = performance.now();
  if (!trigger && !isFile) picture.show(0, picture.view.span, true);
}

/** Whether the trigger's signal has come, or is shown with another factor. */
function isOther({ source }: Trigger): boolean {
  const curve = picture.curves.find(({ name }) => name === source);
  return curve !== undefined && (curve.scale !== finder?.scale || curve.offset !== finder.offset);
}

function fire(time: number): void {
  if (!trigger || state !== "waits") return;
  firedAt = time;
  state = "collects";
}

/** Looks for the trigger in what has come, and shows it once its window is full. */
function lookForTrigger(): void {
  if (!trigger || ring.end === 0) return;
  const { span } = picture.view;
  if (state === "waits" && finder) {
    const row = finder.find(ring, searched, ring.end);
    searched = row < 0 ? ring.end : row + 1;
    if (row >= 0) fire(ring.time(row));
  }
  if (state === "collects" && ring.lastTime >= firedAt + span * (1 - trigger.before)) {
    picture.trigger = firedAt;
    picture.show(firedAt - span * trigger.before, span);
    shownAt = performance.now();
    state = trigger.mode === "single" ? "holds" : "waits";
    // The next one lies behind this window.
    searched = Math.max(searched, ring.rowAt(firedAt + span * (1 - trigger.before)));
  } else if (trigger.mode === "auto" && performance.now() - shownAt > span + PATIENCE) {
    if (!picture.live) picture.show(0, span, true);
  }
}

async function save(order: Extract<Order, { do: "export" }>): Promise<void> {
  const { format } = order;
  try {
    const { start, span } = picture.view;
    const from = order.all ? ring.first : ring.rowAt(start);
    const to = order.all ? ring.end : ring.rowAt(start + span);
    if (format === "png" || format === "svg") {
      const before = picture.view;
      if (order.all) picture.all();
      picture.draw();
      const blob = format === "svg" ? picture.svg() : await picture.png();
      if (order.all) picture.show(before.start, before.span, before.live);
      post({ is: "file", format, blob });
    } else {
      const { curves } = picture;
      const blob = await (format === "csv"
        ? csv(ring, curves, from, to) : mcap(ring, curves, from, to, order.bus));
      post({ is: "file", format, blob });
    }
  } catch (error) {
    post({ is: "failure", text: `The file could not be made: ${(error as Error).message}` });
  }
}

function obey(order: Order): void {
  switch (order.do) {
    case "open": picture.open(order.curves, order.overlay); break;
    case "size": picture.size(order.width, order.height, order.ratio); break;
    case "palette": picture.palette = order.palette; picture.spoil(); break;
    case "batch": {
      ring.take(readBatch(order.data));
      if (ring.amended) picture.spoil();
      ring.amended = false;
      lookForTrigger();
      break;
    }
    case "restart":
      ring.restart();
      isFile = order.file;
      ring.limits = isFile ? FILE_LIMITS : LIVE_LIMITS;
      break;
    case "types": ring.setTypes(new Map(order.types)); break;
    case "curves":
      Object.assign(picture, { curves: order.curves, stacked: order.stacked, limits: order.limits });
      if (order.curves.length === 0) ring.clear();
      ring.keep(order.curves.map(({ name }) => name), order.generation);
      picture.spoil();
      if (trigger && isOther(trigger)) setTrigger(trigger);
      break;
    case "zoom": picture.zoom(order.factor, order.at); break;
    case "pan": picture.pan(order.part); break;
    case "window": picture.show(order.start, order.span); break;
    case "live": picture.show(0, order.span ?? picture.view.span, true); break;
    case "all": picture.all(); break;
    case "cursors": picture.cursors = order.cursors; break;
    case "step": step(order.cursor, order.cycles); break;
    case "hover": picture.hover = order.time; break;
    case "marks": {
      const known = new Set(picture.marks.map(({ time, text }) => `${time} ${text}`));
      picture.marks = order.marks;
      for (const { time, kind, text } of order.marks) {
        const matches = trigger?.kind === "event" && (!trigger.source || trigger.source === kind);
        if (matches && time > ring.lastTime - 5000 && !known.has(`${time} ${text}`)) fire(time);
      }
      break;
    }
    case "trigger": setTrigger(order.trigger); break;
    case "moment": picture.trigger = moment = order.time; break;
    case "statistics": wantsStatistics = order.on; lastStatistics = 0; break;
    case "detail": detail.open(order.canvas, order.width, order.height, order.ratio); lastStatistics = 0; break;
    case "look": look = order.look; lastStatistics = 0; break;
    case "export": void save(order); break;
  }
  if (counts(order)) obeyed++;
  due();
}

self.onmessage = ({ data }: MessageEvent<Order>) => obey(data);
