// Histograms of times, and the difference of two readings of one.
import type { Bucket, Distribution } from "./maps";

/** What came between two readings of a histogram; all of `now` if it began anew. */
export function difference(now: Bucket[], before: Bucket[]): Bucket[] {
  const counts = new Map(before.map(([low, , count]) => [low, count]));
  const left: Bucket[] = now.map(([low, high, count]) => [low, high, count - (counts.get(low) ?? 0)]);
  return left.some(([, , count]) => count < 0) ? now : left.filter(([, , count]) => count > 0);
}

/** The upper bound of the step that holds this share of the samples. */
export function quantile(buckets: Bucket[], share: number): number | undefined {
  const total = buckets.reduce((sum, [, , count]) => sum + count, 0);
  let sum = 0;
  for (const [, high, count] of buckets) {
    sum += count;
    if (sum >= share * total) return high;
  }
  return undefined;
}

export interface Marks {
  count: number;
  p50: number | undefined;
  p99: number | undefined;
  p999: number | undefined;
  max: number | undefined;
}

/** The marks of a whole distribution, which the daemon knows better than its steps say. */
export function marks(distribution: Distribution): Marks {
  const { count, p50, p99, p999, max } = distribution;
  return { count, p50, p99, p999, max };
}

export function marksOf(buckets: Bucket[]): Marks {
  const count = buckets.reduce((sum, bucket) => sum + bucket[2], 0);
  const at = (share: number) => quantile(buckets, share);
  return { count, p50: at(0.5), p99: at(0.99), p999: at(0.999), max: buckets.at(-1)?.[1] };
}

/** Steps of equal width on a logarithmic axis: counts of `places` columns from `low` to `high`. */
export function columns(buckets: Bucket[], low: number, high: number, places: number): number[] {
  const counts = new Array<number>(places).fill(0);
  const place = (value: number) => (Math.log(Math.max(value, low) / low) / Math.log(high / low)) * places;
  for (const [from, to, count] of buckets) {
    const begin = Math.max(0, Math.min(places - 1e-6, place(from)));
    const end = Math.max(begin + 1e-6, Math.min(places, place(to)));
    for (let at = Math.floor(begin); at < end; at += 1) {
      const part = (Math.min(at + 1, end) - Math.max(at, begin)) / (end - begin);
      counts[at]! += count * part;
    }
  }
  return counts;
}
