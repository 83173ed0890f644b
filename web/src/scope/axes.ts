// Where lanes lie, which values they show, ticks and their texts.
import type { Curve, Lane, Mark, Palette, View } from "./messages";
import type { Pen } from "./pen";
import { Extent } from "./pyramid";
import type { Ring } from "./ring";

const GUTTER = 58;
/** The same where lanes have names there. */
const NAMES = 104;
const RIGHT = 10;
const TOP = 8;
const GAP = 12;
const DIGITAL = 30;
/** Room below the lanes for the track of events and the times. */
export const TRACK = 14;
const TIMES = 22;
/** Width of the date at the lower left corner. */
const DATE = 66;

export interface Plot {
  left: number;
  width: number;
  /** Below the lanes. */
  bottom: number;
  lanes: Lane[];
}

/**
 * Lays the lanes out; their values come from `limits`, from `before`, or from the window's rows.
 *
 * @param grows Whether the rows are only those that are new since `before`, so axes do not shrink.
 */
export function layOut(
  curves: Curve[], stacked: boolean, width: number, height: number,
  limits: Record<string, [number, number]>, before: Lane[],
  ring: Ring, from: number, to: number, grows: boolean,
): Plot {
  const groups = new Map<string, Curve[]>();
  for (const curve of curves) {
    if (curve.hidden) continue;
    const axis = curve.digital ? `digital ${curve.name}` : curve.axis;
    groups.set(axis, [...(groups.get(axis) ?? []), curve]);
  }
  const analog = [...groups].filter(([, [first]]) => !first!.digital);
  const digital = [...groups].filter(([, [first]]) => first!.digital);
  const left = Math.max(
    GUTTER * (stacked ? 1 : Math.max(1, analog.length)), digital.length > 0 ? NAMES : 0,
  );
  const bottom = height - TIMES - TRACK;
  const most = (bottom - TOP) * (analog.length > 0 ? 0.5 : 0.9);
  // Alone they have more room, from the top.
  const small = Math.min(DIGITAL * (analog.length > 0 ? 1 : 3), most / Math.max(1, digital.length));
  const high = analog.length > 0 ? bottom - TOP - digital.length * small : 0;
  const of = (axis: string) => before.find((lane) => lane.axis === axis);
  const lanes = analog.map(([axis, [...all]], i): Lane => {
    const each = stacked ? (high - GAP * (analog.length - 1)) / analog.length : high - 4;
    return {
      axis, title: all[0]!.unit || (all.length === 1 ? all[0]!.label : axis.replace(/^unit .*/, "")), digital: false,
      names: all.map((curve) => curve.name),
      left: stacked ? left : left - GUTTER * (analog.length - 1 - i),
      top: TOP + (stacked ? i * (each + GAP) : 0),
      height: Math.max(10, each - (digital.length && stacked ? 4 : 0)),
      ...(limits[axis]
        ? { low: limits[axis][0], high: limits[axis][1] }
        : automatic(range(all, ring, from, to), of(axis), grows)),
    };
  });
  digital.forEach(([axis, [curve]], i) => {
    const keys = Object.keys(curve!.values).map(Number);
    const values = keys.map((key) => key * curve!.scale + curve!.offset);
    const old = grows ? of(axis) : undefined;
    const ends = [0, 1, ...values, ...range([curve!], ring, from, to), old?.low ?? 0, old?.high ?? 1];
    const known = ends.filter(Number.isFinite);
    lanes.push({
      axis, title: curve!.label, digital: true, names: [curve!.name], left,
      top: TOP + high + i * small + small / 6, height: Math.max(2, small * 0.7),
      low: Math.min(...known), high: Math.max(...known),
    });
  });
  return { left, width: Math.max(1, width - left - RIGHT), bottom, lanes };
}

/** Least and greatest physical value of curves in rows. */
function range(curves: Curve[], ring: Ring, from: number, to: number): [number, number] {
  let low = Infinity;
  let high = -Infinity;
  for (const curve of curves) {
    const extent = new Extent();
    ring.extent(curve.name, Math.max(ring.first, from - 1), to, extent);
    if (extent.min > extent.max) continue;
    const ends = [extent.min, extent.max].map((raw) => raw * curve.scale + curve.offset);
    low = Math.min(low, ...ends);
    high = Math.max(high, ...ends);
  }
  return [low, high];
}

/**
 * Values of an axis with some room; as before while the curves fill about half of it. Where they
 * leave it they get more room, so that they do not leave it again with the next picture.
 */
function automatic(
  [low, high]: [number, number], before: Lane | undefined, grows: boolean,
): { low: number; high: number } {
  if (low > high) return before ?? { low: 0, high: 1 };
  if (before && low >= before.low && high <= before.high) {
    const filled = (high - low) / (before.high - before.low);
    if (grows || filled > 0.45 || (low === high && before.high - before.low < 4 * room(low))) {
      return { low: before.low, high: before.high };
    }
  }
  if (before && grows) {
    const much = (Math.max(high, before.high) - Math.min(low, before.low)) * 0.25;
    return {
      low: low < before.low ? low - much : before.low,
      high: high > before.high ? high + much : before.high,
    };
  }
  const more = low === high ? room(low) : (high - low) * 0.08;
  return { low: low - more, high: high + more };
}

const room = (value: number) => Math.abs(value) * 0.05 || 1;

/** Values at round distances, about `most` of them. */
export function ticks(low: number, high: number, most: number): number[] {
  const rough = (high - low) / Math.max(1, most);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough * 0.999)!;
  const result = [];
  for (let i = Math.ceil(low / step); i * step <= high; i++) result.push(i * step);
  return result;
}

const STEPS = [
  1, 2, 5, 10, 20, 50, 100, 200, 500, 1e3, 2e3, 5e3, 1e4, 1.5e4, 3e4, 6e4, 12e4, 3e5, 6e5, 18e5,
  36e5, 72e5, 216e5, 432e5, 864e5,
];

/** Times at round distances in ms, in local time. */
export function timeTicks(start: number, span: number, most: number): { times: number[]; step: number } {
  const rough = span / Math.max(1, most);
  let step = STEPS.find((each) => each >= rough) ?? 864e5;
  if (rough < 1) step = ticks(0, span, most)[1] ?? 1;
  const zone = new Date(start).getTimezoneOffset() * 60e3;
  const times = [];
  for (let i = Math.ceil((start - zone) / step); i * step + zone <= start + span; i++) {
    times.push(i * step + zone);
  }
  return { times, step };
}

const two = (value: number) => String(value).padStart(2, "0");

export function timeText(time: number, step: number): string {
  const date = new Date(time);
  const whole = `${two(date.getHours())}:${two(date.getMinutes())}:${two(date.getSeconds())}`;
  if (step >= 1000) return whole;
  const digits = step >= 100 ? 1 : step >= 10 ? 2 : step >= 1 ? 3 : 6;
  const part = (((time % 1000) + 1000) % 1000).toFixed(Math.max(0, digits - 3));
  const [ms, micro] = part.split(".");
  return `${whole}.${ms!.padStart(3, "0").slice(0, Math.min(3, digits))}${micro ?? ""}`;
}

function dateText(time: number): string {
  const date = new Date(time);
  return `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())}`;
}

export function numberText(value: number): string {
  const size = Math.abs(value);
  if (Number.isFinite(value) && size !== 0 && (size >= 1e7 || size < 1e-4)) {
    return value.toExponential(2).replace("e+", "e");
  }
  return Number.isFinite(value) ? String(Number(value.toPrecision(6))) : String(value);
}

/**
 * Texts of ticks. Where only their last digits differ, such as those of a counter, they are the
 * difference to `base`, which stands above.
 */
export function tickTexts(values: number[]): { base: number; texts: string[] } {
  const [low = 0, next = low] = values;
  const step = next - low;
  const largest = Math.max(...values.map(Math.abs));
  const base = step > 0 && largest / step > 1e4 ? low : 0;
  return { base, texts: values.map((value) => (base === 0 ? "" : "+") + numberText(value - base)) };
}

/** Draws grid, axes, events and cursors. */
export function drawAxes(
  pen: Pen, plot: Plot, view: View, palette: Palette, curves: Curve[], marks: Mark[],
  cursors: number[], trigger: number | null,
): void {
  const { left, width, bottom, lanes } = plot;
  const x = (time: number) => left + ((time - view.start) / view.span) * width;
  const { times, step } = timeTicks(view.start, view.span, width / 110);
  for (const time of times) {
    pen.line(x(time), TOP, x(time), bottom, palette.line);
    if (x(time) < left + width - 20 && x(time) > DATE + 30) {
      pen.text(x(time), bottom + TRACK + 11, timeText(time, step), palette.faint, "center");
    }
  }
  pen.text(4, bottom + TRACK + 11, dateText(view.start), palette.faint);
  const colour = (name: string) => curves.find((curve) => curve.name === name)!.colour;
  let across = true;
  for (const lane of lanes) {
    const low = lane.top + lane.height;
    if (lane.digital) {
      const text = lane.title.split("/").pop()!;
      pen.box(4, lane.top, 3, lane.height, colour(lane.names[0]!));
      pen.text(left - 6, lane.top + lane.height / 2, shorten(text, 13), palette.text, "right");
      pen.line(left, low + 4, left + width, low + 4, palette.line);
      continue;
    }
    const values = ticks(lane.low, lane.high, lane.height / 38);
    const { base, texts } = tickTexts(values);
    for (const [i, value] of values.entries()) {
      const y = lane.top + ((lane.high - value) / (lane.high - lane.low)) * lane.height;
      if (across || lane.left === left) pen.line(across ? left : lane.left - 4, y, across ? left + width : lane.left, y, palette.line);
      pen.text(lane.left - 6, y, texts[i]!, palette.faint, "right");
    }
    pen.line(lane.left, lane.top, lane.left, low, palette.faint);
    const own = lane.names.length === 1 ? colour(lane.names[0]!) : palette.text;
    const title = base === 0 ? lane.title : `${lane.title}  ${base} +`.trim();
    pen.text(lane.left + 6, lane.top + 7, title, own, "left", true);
    across = lanes.every((other) => other.digital || other.left === lane.left);
  }
  pen.line(left, bottom, left + width, bottom, palette.faint);
  pen.text(left - 6, bottom + TRACK / 2 + 1, "events", palette.faint, "right");
  for (const mark of marks) {
    if (mark.time < view.start || mark.time > view.start + view.span) continue;
    const tone = { error: palette.error, warning: palette.warning }[mark.severity] ?? palette.accent;
    pen.line(x(mark.time), TOP, x(mark.time), bottom, tone, [2, 4]);
    pen.box(x(mark.time) - 3, bottom + 4, 7, 7, tone);
  }
  if (trigger !== null && trigger >= view.start && trigger <= view.start + view.span) {
    pen.line(x(trigger), TOP, x(trigger), bottom, palette.accent);
    pen.text(x(trigger) + 4, TOP + 6, "T", palette.accent, "left", true);
  }
  cursors.forEach((time, i) => {
    if (!(time >= view.start && time <= view.start + view.span)) return;
    pen.line(x(time), 0, x(time), bottom, palette.text, [5, 3]);
    pen.box(x(time) - 8, 0, 16, 14, palette.text);
    pen.text(x(time), 7, "AB"[i]!, palette.background, "center", true);
  });
}

/** Names of a slave differ at their ends. */
const shorten = (text: string, most: number) =>
  text.length > most ? `${text.slice(0, 3)}…${text.slice(4 - most)}` : text;
