// Finds signals by a part of their names.
import type { Signal } from "../protocol";

/** How well a text has the words of a query: 0 is best; null: not at all. */
export function rank(query: string, text: string): number | null {
  const low = text.toLowerCase();
  if (low.includes(query.toLowerCase().trim())) return 0;
  let total = 1;
  for (const word of query.toLowerCase().split(/\s+/).filter(Boolean)) {
    const at = low.indexOf(word);
    if (at >= 0) {
      total += /[\w]/.test(low[at - 1] ?? " ") ? 2 : 0;
      continue;
    }
    let place = -1;
    let holes = 0;
    for (const letter of word) {
      const next = low.indexOf(letter, place + 1);
      if (next < 0) return null;
      holes += place >= 0 ? next - place - 1 : 0;
      place = next;
    }
    if (holes > 3 * word.length) return null;
    total += 5 + holes;
  }
  return total;
}

/** The best signals for a query. */
export function search(signals: Iterable<Signal>, query: string, most: number): Signal[] {
  const found: [number, Signal][] = [];
  for (const signal of signals) {
    const at = rank(query, `${signal.label} ${signal.name}`);
    if (at !== null) found.push([at, signal]);
  }
  found.sort(([a], [b]) => a - b);
  return found.slice(0, most).map(([, signal]) => signal);
}
