// Triggers: looked for in each cycle.
import { BLOCK, VALID } from "./pyramid";
import type { Ring } from "./ring";

export interface Trigger {
  kind: "edge" | "level" | "window" | "event";
  /** Signal, or for "event" the kind of event ("" for each one). */
  source: string;
  /** Physical. For "window", `level` and `upper` are its ends. */
  level: number;
  upper: number;
  /** Edge: direction; level: above or below; window: outside (rising) or inside (falling). */
  slope: "rising" | "falling" | "both";
  /** Part of the picture before the trigger: 0 to 1. */
  before: number;
  mode: "auto" | "normal" | "single";
}

/** Finds the first row that fulfils the condition. Keeps the value of the row before. */
export class Finder {
  #previous = NaN;

  constructor(
    readonly trigger: Trigger,
    readonly scale: number,
    readonly offset: number,
  ) {}

  /** Looks at the rows `from` to `to` (excluded); returns the first that fires, or -1. */
  find(ring: Ring, from: number, to: number): number {
    let found = -1;
    for (let row = Math.max(from, ring.first); row < to; row++) {
      const samples = ring.samples(this.trigger.source, row);
      const at = row % BLOCK;
      const flags = samples?.flags[at] ?? 0;
      if (!samples || flags !== VALID) {
        this.#previous = NaN;
        continue;
      }
      const a = samples.low(at) * this.scale + this.offset;
      const b = samples.high(at) * this.scale + this.offset;
      const [low, high] = a < b ? [a, b] : [b, a];
      const fires = this.#holds(low, high);
      this.#previous = b;
      if (fires) {
        found = row;
        break;
      }
    }
    return found;
  }

  /** A place has the values from `low` to `high`; both are equal unless it stands for several. */
  #holds(low: number, high: number): boolean {
    const { kind, level, upper, slope } = this.trigger;
    const before = this.#previous;
    if (kind === "level") {
      return (slope !== "falling" && high >= level) || (slope !== "rising" && low <= level);
    }
    if (kind === "window") {
      const [bottom, top] = level < upper ? [level, upper] : [upper, level];
      const outside = low < bottom || high > top;
      const inside = low <= top && high >= bottom;
      if (Number.isNaN(before)) return false;
      const wasOutside = before < bottom || before > top;
      if (slope === "rising") return outside && !wasOutside;
      if (slope === "falling") return inside && wasOutside;
      return (outside && !wasOutside) || (inside && wasOutside);
    }
    const rises = (before < level && high >= level) || (low < level && high >= level);
    const falls = (before > level && low <= level) || (high > level && low <= level);
    if (Number.isNaN(before) && low === high) return false;
    return (slope !== "falling" && rises) || (slope !== "rising" && falls);
  }
}
