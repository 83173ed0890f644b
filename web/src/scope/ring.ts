// The samples of the last minutes: blocks of rows, one row for each cycle; the oldest block goes.
import type { Batch, Column, ColumnType } from "../protocol";
import { type Bit, bitIn, bitOf } from "./bits";
import { BLOCK, type Extent, OLD, Samples, VALID } from "./pyramid";

/** Flags of a row. It does not follow the row before. */
export const GAP = 1;
/** It stands for several cycles, with the least and greatest value of each signal. */
export const MINMAX = 2;
/** A gap for which nobody asked for values, so that none is missing. */
export const PAUSE = 4;

/** ms by which times may go back without a step of the clock, as computers know them so well only. */
const JITTER = 200;

export class Block {
  count = 0;
  /** Cycles that are missing before its rows. */
  missing = 0;
  /** Rows with a pause before them. */
  pauses = 0;
  readonly cycles = new Float64Array(BLOCK);
  readonly times = new Float64Array(BLOCK);
  readonly flags = new Uint8Array(BLOCK);
  lastCycles: Float64Array | null = null;
  readonly columns = new Map<string, Samples>();

  get bytes(): number {
    let bytes = BLOCK * 17 + (this.lastCycles?.byteLength ?? 0);
    for (const samples of this.columns.values()) bytes += samples.bytes;
    return bytes;
  }

  lastCycle(at: number): number {
    return this.lastCycles?.[at] || this.cycles[at]!;
  }
}

export interface Limits {
  /** ms that are kept. */
  time: number;
  /** Bytes that are kept at most. */
  bytes: number;
}

/** Rows have numbers that stay, from `first` to `end` (excluded); times ascend. */
export class Ring {
  #blocks: Block[] = [];
  /** Number of the first block. */
  #base = 0;
  end = 0;
  bytes = 0;
  /** Whether rows went because of the limit of bytes, before their time was over. */
  short = false;
  /** Cycles that are missing in what is kept: they were lost while signals were recorded. */
  missing = 0;
  /** How often nothing was recorded for a while. */
  pauses = 0;
  minmax = false;
  /** ms by which times are later than received, since somebody set the clock back. */
  shift = 0;
  /** First row of the present run of the daemon, whose numbers of cycles ascend. */
  #run = 0;
  /** Whether rows that were there got more values. */
  amended = false;
  /** The signals that are kept, with the generation of the first wish for them; null: all. */
  #wanted: Map<string, number> | null = null;
  #bits = new Map<string, Bit>();
  private generation = -1;
  #lastOfGeneration = -1;

  constructor(
    public limits: Limits,
    /** Types of the signals, for places that came as minima and maxima. */
    public types: ReadonlyMap<string, ColumnType> = new Map(),
  ) {}

  get first(): number {
    return this.#base * BLOCK;
  }

  get firstTime(): number {
    return this.end > 0 ? this.#blocks[0]!.times[0]! : NaN;
  }

  get lastTime(): number {
    return this.end > 0 ? this.time(this.end - 1) : NaN;
  }

  /** The block of a row that is kept. */
  block(row: number): Block {
    return this.#blocks[Math.floor(row / BLOCK) - this.#base]!;
  }

  time(row: number): number {
    return this.block(row).times[row % BLOCK]!;
  }

  cycle(row: number): number {
    return this.block(row).cycles[row % BLOCK]!;
  }

  lastCycle(row: number): number {
    return this.block(row).lastCycle(row % BLOCK);
  }

  rowFlags(row: number): number {
    return this.block(row).flags[row % BLOCK]!;
  }

  /**
   * The first row at or after a time; `end` if there is none.
   *
   * @param from A row that is not behind it; the search is short if it is near.
   */
  rowAt(time: number, from = this.first): number {
    let low = from;
    let step = 1;
    while (low + step < this.end && this.time(low + step - 1) < time) {
      low += step;
      step *= 2;
    }
    return this.#search(low, (row) => this.time(row) >= time, Math.min(this.end, low + step));
  }

  /** The first row from `from` that `holds`; all behind it hold, too. */
  #search(from: number, holds: (row: number) => boolean, end = this.end): number {
    let low = from;
    let high = end;
    while (low < high) {
      const middle = Math.floor((low + high) / 2);
      if (holds(middle)) high = middle;
      else low = middle + 1;
    }
    return low;
  }

  samples(name: string, row: number): Samples | undefined {
    return this.block(row).columns.get(name);
  }

  /** Flags of a sample: 0 if there is none. */
  flags(name: string, row: number): number {
    return this.samples(name, row)?.flags[row % BLOCK] ?? 0;
  }

  /** Adds the values of the rows `from` to `to` (excluded) to `extent`. */
  extent(name: string, from: number, to: number, extent: Extent): void {
    for (let row = Math.max(from, this.first); row < to; ) {
      const begin = row % BLOCK;
      const stop = Math.min(BLOCK, begin + to - row);
      this.samples(name, row)?.extent(begin, stop, extent);
      row += stop - begin;
    }
  }

  /** Calls `look` for the rows `from` to `to` (excluded), block by block. */
  each(from: number, to: number, look: (block: Block, from: number, to: number) => void): void {
    for (let row = Math.max(from, this.first); row < Math.min(to, this.end); ) {
      const begin = row % BLOCK;
      const stop = Math.min(BLOCK, begin + Math.min(to, this.end) - row);
      look(this.block(row), begin, stop);
      row += stop - begin;
    }
  }

  /** Rows that do not follow the row before. */
  *gaps(from: number, to: number): Generator<number> {
    for (let row = Math.max(from, this.first); row <= to; row++) {
      if (row % BLOCK === 0 && !this.block(row).flags.includes(GAP)) row += BLOCK - 1;
      else if (this.rowFlags(row) & GAP) yield row;
    }
  }

  /** Types of the signals from now on. What has another type is of another bus, and goes. */
  setTypes(types: ReadonlyMap<string, ColumnType>): void {
    this.types = types;
    for (const block of this.#blocks) {
      for (const [name, samples] of block.columns) {
        if ((types.get(name) ?? samples.type) === samples.type) continue;
        this.bytes -= samples.bytes;
        block.columns.delete(name);
      }
    }
  }

  /** Values come anew, after a pause: they may reach back. */
  restart(): void {
    this.generation = -1;
  }

  clear(): void {
    this.#blocks = [];
    this.#bits = new Map();
    this.#wanted = null;
    this.#base = this.#run = this.end = this.bytes = this.missing = this.pauses = this.shift = 0;
    this.#lastOfGeneration = -1;
    this.short = this.minmax = this.amended = false;
    this.restart();
  }

  /** Keeps only these signals, which may be bits of others, now and from this generation on. */
  keep(names: Iterable<string>, generation = 0): void {
    this.#bits = new Map();
    const before = this.#wanted;
    this.#wanted = new Map();
    const want = (name: string) => this.#wanted!.set(name, before?.get(name) ?? generation);
    for (const name of names) {
      want(name);
      const bit = this.types.has(name) ? null : bitOf(name);
      if (!bit || !this.types.has(bit.source)) continue;
      this.#bits.set(name, bit);
      want(bit.source);
    }
    for (const block of this.#blocks) {
      for (const [name, samples] of block.columns) {
        if (this.#wanted.has(name)) continue;
        this.bytes -= samples.bytes;
        block.columns.delete(name);
      }
      const before = block.bytes;
      for (const [name, bit] of this.#bits) {
        if (block.columns.has(name)) continue;
        for (let at = 0; at < block.count; at++) fillBit(block, at, name, bit);
      }
      this.bytes += block.bytes - before;
    }
  }

  /** Takes the cycles of a batch. Those that are there get the signals that they lack. */
  take(batch: Batch): void {
    const reachesBack = batch.kind === "history";
    // Another part of the page may have had a signal before it was wanted here: those values are none
    // of the scope, as they would come before its history.
    const least = reachesBack ? Infinity : batch.generation;
    if (this.#wanted && ![...batch.columns.keys()].some((name) => this.#wanted!.get(name)! <= least)) return;
    const isNew = reachesBack || batch.generation !== this.generation;
    if (isNew) this.#lastOfGeneration = -1;
    this.generation = batch.generation;
    const old = new Map<string, Set<number>>();
    for (const [name, places] of batch.invalid) old.set(name, new Set(places));
    const touched = new Map<Block, number>();
    for (let at = 0; at < batch.cycles.length; at++) {
      const cycle = batch.cycles[at]!;
      const last = batch.lastCycles?.[at] ?? cycle;
      const row = this.#place(cycle, last, batch.times[at]!, at === 0 && isNew && !batch.lost);
      this.#lastOfGeneration = last;
      if (row < 0) continue;
      const block = this.block(row);
      if (!touched.has(block)) touched.set(block, block.bytes);
      this.#fill(block, row % BLOCK, batch, at, old);
    }
    if (reachesBack) this.#lastOfGeneration = -1;
    for (const [block, before] of touched) this.bytes += block.bytes - before;
    this.#forget();
  }

  #fill(
    block: Block, place: number, batch: Batch, at: number, old: Map<string, Set<number>>,
  ): void {
    for (const [name, column] of batch.columns) {
      if (this.#wanted?.has(name) === false) continue;
      let samples = block.columns.get(name);
      if (samples === undefined) {
        const type = this.types.get(name);
        samples = new Samples(type ?? ("values" in column ? typeOf(column.values) : "float64"));
        block.columns.set(name, samples);
      } else if (samples.flags[place] !== 0) continue;
      const flags = old.get(name)?.has(at) ? OLD : VALID;
      if ("values" in column) {
        const value = column.values[at]!;
        samples.set(place, value, value, flags);
      } else samples.set(place, column.min[at]!, column.max[at]!, flags);
    }
    for (const [name, bit] of this.#bits) fillBit(block, place, name, bit);
  }

  /** The row of a cycle, which is made if it is new; -1 if it is too old to be kept. */
  #place(cycle: number, last: number, time: number, pause: boolean): number {
    const empty = this.end === 0;
    const before = empty ? -1 : this.lastCycle(this.end - 1);
    const restarted =
      !empty && cycle <= before &&
      (this.#lastOfGeneration >= 0
        ? cycle <= this.#lastOfGeneration
        : time + this.shift > this.lastTime);
    if (!empty && !restarted && cycle <= before) {
      const row = this.#search(Math.max(this.#run, this.first), (at) => this.lastCycle(at) >= cycle);
      if (row === this.end || this.cycle(row) !== cycle || this.lastCycle(row) !== last) return -1;
      this.amended = true;
      return row;
    }
    const row = this.end;
    const at = row % BLOCK;
    if (at === 0) {
      this.#blocks.push(new Block());
      this.bytes += this.block(row).bytes;
    }
    const block = this.block(row);
    if (!empty && time + this.shift < this.lastTime - JITTER) {
      this.shift = this.lastTime + 0.001 - time;
    }
    block.cycles[at] = cycle;
    block.times[at] = empty ? time : Math.max(time + this.shift, this.lastTime + 0.001);
    if (last !== cycle) {
      this.bytes += block.lastCycles ? 0 : BLOCK * 8;
      (block.lastCycles ??= new Float64Array(BLOCK))[at] = last;
      block.flags[at]! |= MINMAX;
      this.minmax = true;
    }
    if (restarted) this.#run = row;
    if (!empty && (restarted || cycle !== before + 1)) {
      block.flags[at]! |= pause ? GAP | PAUSE : GAP;
      const missing = pause || restarted ? 0 : cycle - before - 1;
      block.missing += missing;
      this.missing += missing;
      block.pauses += +pause;
      this.pauses += +pause;
    }
    block.count = at + 1;
    this.end = row + 1;
    return row;
  }

  #forget(): void {
    while (this.#blocks.length > 2) {
      const tooMuch = this.bytes > this.limits.bytes;
      if (!tooMuch && this.lastTime - this.#blocks[1]!.times[0]! < this.limits.time) break;
      this.short ||= tooMuch;
      const gone = this.#blocks.shift()!;
      this.bytes -= gone.bytes;
      this.missing -= gone.missing;
      this.pauses -= gone.pauses;
      this.#base++;
    }
  }
}

/** Fills a bit from the signal that has it. */
function fillBit(block: Block, at: number, name: string, { source, bit }: Bit): void {
  const from = block.columns.get(source);
  const flags = from?.flags[at] ?? 0;
  if (!from || flags === 0) return;
  let samples = block.columns.get(name);
  if (!samples) block.columns.set(name, (samples = new Samples("uint8")));
  if (samples.flags[at] !== 0) return;
  const [low, high] = bitIn(from.values[at]!, (from.upper ?? from.values)[at]!, bit);
  samples.set(at, low, high, flags);
}

function typeOf(values: Column): ColumnType {
  return values.constructor.name
    .replace("Array", "").replace("Big", "").toLowerCase() as ColumnType;
}
