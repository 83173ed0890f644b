// Statistics of a window: exact over each sample, kept for whole blocks.
import { BLOCK, OLD, type Samples, VALID } from "./pyramid";
import type { Ring } from "./ring";

export interface Statistics {
  count: number;
  min: number;
  max: number;
  mean: number;
  rms: number;
  deviation: number;
  peakToPeak: number;
  /** Samples whose slave took no part. */
  old: number;
  /** Cycles that were not exchanged, or were lost on the way. */
  missing: number;
}

/** Moments of some samples (raw); `square`: sum of squared differences from the mean. */
class Moments {
  count = 0;
  mean = 0;
  square = 0;
  min = Infinity;
  max = -Infinity;
  old = 0;

  add(value: number): void {
    const difference = value - this.mean;
    this.mean += difference / ++this.count;
    this.square += difference * (value - this.mean);
    if (value < this.min) this.min = value;
    if (value > this.max) this.max = value;
  }

  /** Chan, Golub, LeVeque (1979): moments of two sets together. */
  join(other: Moments): void {
    const count = this.count + other.count;
    if (other.count > 0) {
      const difference = other.mean - this.mean;
      this.square += other.square + (difference * difference * this.count * other.count) / count;
      this.mean += (difference * other.count) / count;
    }
    this.count = count;
    this.min = Math.min(this.min, other.min);
    this.max = Math.max(this.max, other.max);
    this.old += other.old;
  }
}

const WHOLE = new WeakMap<Samples, Moments>();

function moments(samples: Samples, from: number, to: number): Moments {
  const result = new Moments();
  for (let row = from; row < to; row++) {
    const flags = samples.flags[row]!;
    if (flags === VALID) {
      result.add(samples.low(row));
      if (samples.upper && samples.high(row) !== samples.low(row)) result.add(samples.high(row));
    } else if (flags & OLD) result.old++;
  }
  return result;
}

/** Statistics of the rows `from` to `to` (excluded), as physical value = raw * scale + offset. */
export function statistics(
  ring: Ring, name: string, from: number, to: number, scale = 1, offset = 0,
): Statistics {
  const all = new Moments();
  ring.each(from, to, (block, begin, end) => {
    const isWhole = begin === 0 && end === BLOCK;
    const samples = block.columns.get(name);
    if (samples) {
      let part = isWhole ? WHOLE.get(samples) : undefined;
      part ??= moments(samples, begin, end);
      // History that comes later may still fill the block, unless it has each sample.
      if (isWhole && part.count + part.old >= BLOCK) WHOLE.set(samples, part);
      all.join(part);
    }
  });
  const ends = [all.min * scale + offset, all.max * scale + offset];
  const mean = all.mean * scale + offset;
  const variance = all.count > 0 ? (all.square / all.count) * scale * scale : NaN;
  const some = all.count > 0;
  return {
    count: all.count,
    min: some ? Math.min(...ends) : NaN,
    max: some ? Math.max(...ends) : NaN,
    mean: some ? mean : NaN,
    rms: Math.sqrt(variance + mean * mean),
    deviation: Math.sqrt(variance),
    peakToPeak: some ? Math.abs((all.max - all.min) * scale) : NaN,
    old: all.old,
    missing: missingCycles(ring, from, to),
  };
}

/** Cycles that are missing between rows of a window. */
export function missingCycles(ring: Ring, from: number, to: number): number {
  let missing = 0;
  let before = NaN;
  ring.each(from, to, (block, begin, end) => {
    if (begin === 0 && end === BLOCK && block.missing === 0) {
      if (block.cycles[0]! > before + 1) missing += block.cycles[0]! - before - 1;
    } else {
      for (let at = begin; at < end; at++) {
        const cycle = block.cycles[at]!;
        if (cycle > before + 1) missing += cycle - before - 1;
        before = block.lastCycle(at);
      }
    }
    before = block.lastCycle(end - 1);
  });
  return missing;
}
