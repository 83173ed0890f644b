// The last value of each signal that a panel shows, at most ten times a second.
import { signal } from "@preact/signals";

import { type Column, readBatch } from "./protocol";
import type { Traces, Tracer } from "./traces";

const EVERY_MS = 100;

export interface Last {
  value: Column[number];
  /** Its slave took no part: the value is an older one. */
  old: boolean;
}

export class LiveValues {
  readonly values = signal<ReadonlyMap<string, Last>>(new Map());
  private readonly part: Tracer;
  #wanted = new Set<string>();
  #coming = new Map<string, Last>();
  #waits = false;

  constructor(traces: Traces) {
    this.part = traces.part();
  }

  want(names: string[]): void {
    this.#wanted = new Set(names);
    this.#coming = new Map([...this.#coming].filter(([name]) => this.#wanted.has(name)));
    this.part.setTrace(names);
  }

  takeBatch(data: ArrayBuffer): void {
    if (this.#wanted.size === 0) return;
    const batch = readBatch(data);
    const last = batch.cycles.length - 1;
    if (last < 0 || batch.kind === "history") return;
    for (const [name, column] of batch.columns) {
      if (!this.#wanted.has(name)) continue;
      const value = "values" in column ? column.values[last]! : column.max[last]!;
      this.#coming.set(name, { value, old: batch.invalid.get(name)?.includes(last) ?? false });
    }
    if (this.#waits) return;
    this.#waits = true;
    setTimeout(() => {
      this.#waits = false;
      this.values.value = new Map(this.#coming);
    }, EVERY_MS);
  }
}
