// Layouts: what the scope shows, kept by the browser and shared as a file.
import type { Trigger } from "./trigger";

export interface Entry {
  name: string;
  colour: number;
  /** Signals with the same one share an axis; empty: the one of its unit. */
  axis: string;
  /** Factor by which the picture shows it. */
  gain: number;
  hidden: boolean;
}

export interface Layout {
  signals: Entry[];
  stacked: boolean;
  /** Least and greatest value of axes that are not automatic. */
  limits: Record<string, [number, number]>;
  /** ms */
  span: number;
  trigger: Trigger | null;
}

export const MOST_SIGNALS = 64;
const FORMAT = "ecatd scope layout";

export class LayoutError extends Error {}

export function writeLayout(layout: Layout): string {
  return JSON.stringify({ format: FORMAT, version: 1, ...layout }, null, 2);
}

/** Reads a layout, which may come from anybody. Raises `LayoutError`, which says what is wrong. */
export function readLayout(text: string): Layout {
  if (text.length > 1e6) throw new LayoutError("The file is too long for a layout.");
  let data: unknown;
  try {
    data = JSON.parse(text);
  } catch {
    throw new LayoutError("The file is no JSON. Choose one that the scope has exported.");
  }
  const all = map(data, "the file");
  if (all.format !== FORMAT) throw new LayoutError(`The file is no layout: "format" is not "${FORMAT}".`);
  if (all.version !== 1) throw new LayoutError("The layout has a version that this page does not know.");
  if (!Array.isArray(all.signals)) throw new LayoutError("signals: a list is needed.");
  if (all.signals.length > MOST_SIGNALS) {
    throw new LayoutError(`signals: ${all.signals.length} are too many; at most ${MOST_SIGNALS}.`);
  }
  const signals = all.signals.map((each: unknown, i): Entry => {
    const at = `signals[${i}]`;
    const entry = map(each, at);
    return {
      name: string(entry.name, `${at}.name`),
      colour: number(entry.colour ?? i, `${at}.colour`, 0, 1000) | 0,
      axis: string(entry.axis ?? "", `${at}.axis`),
      gain: number(entry.gain ?? 1, `${at}.gain`, -1e12, 1e12) || 1,
      hidden: entry.hidden === true,
    };
  });
  if (new Set(signals.map(({ name }) => name)).size < signals.length) {
    throw new LayoutError("signals: one is there twice.");
  }
  const limits: Layout["limits"] = Object.create(null);
  for (const [axis, ends] of Object.entries(map(all.limits ?? {}, "limits")).slice(0, MOST_SIGNALS)) {
    if (!Array.isArray(ends)) throw new LayoutError(`limits.${axis}: two numbers are needed.`);
    const low = number(ends[0], `limits.${axis}[0]`);
    const high = number(ends[1], `limits.${axis}[1]`);
    if (low >= high) throw new LayoutError(`limits.${axis}: the first must be less than the second.`);
    limits[axis] = [low, high];
  }
  return {
    signals, limits, stacked: all.stacked !== false,
    span: number(all.span ?? 10e3, "span", 0.05, 6e8),
    trigger: all.trigger == null ? null : readTrigger(all.trigger),
  };
}

function readTrigger(data: unknown): Trigger {
  const all = map(data, "trigger");
  return {
    kind: one(all.kind, "trigger.kind", ["edge", "level", "window", "event"]),
    source: string(all.source, "trigger.source"),
    level: number(all.level ?? 0, "trigger.level"),
    upper: number(all.upper ?? 0, "trigger.upper"),
    slope: one(all.slope ?? "rising", "trigger.slope", ["rising", "falling", "both"]),
    before: number(all.before ?? 0.5, "trigger.before", 0, 1),
    mode: one(all.mode ?? "normal", "trigger.mode", ["auto", "normal", "single"]),
  };
}

function map(value: unknown, at: string): Record<string, unknown> {
  if (typeof value !== "object" || value === null || Array.isArray(value)) {
    throw new LayoutError(`${at}: a JSON object is needed.`);
  }
  return value as Record<string, unknown>;
}

function string(value: unknown, at: string): string {
  if (typeof value !== "string" || value.length > 200) {
    throw new LayoutError(`${at}: a text of at most 200 characters is needed.`);
  }
  return value;
}

function number(value: unknown, at: string, low = -1e300, high = 1e300): number {
  if (typeof value !== "number" || !(value >= low && value <= high)) {
    throw new LayoutError(`${at}: a number from ${low} to ${high} is needed.`);
  }
  return value;
}

function one<T extends string>(value: unknown, at: string, choices: T[]): T {
  if (!choices.includes(value as T)) throw new LayoutError(`${at}: one of ${choices.join(", ")} is needed.`);
  return value as T;
}
