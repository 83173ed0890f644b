// Least and greatest values of 16, 256 and 4096 rows, so that each zoom needs few steps.
import type { Column, ColumnType } from "../protocol";

/** Rows of a block. */
export const BLOCK = 4096;
const NODES = 256 + 16 + 1;
const SECOND = 256;
const THIRD = 272;

/** What is known of a sample, or of some of them together. 0: nothing was received. */
export const VALID = 1;
/** The slave took no part in the cycle, so its value is older. */
export const OLD = 2;
/** NaN or infinite: there is nothing to draw. */
export const NO_NUMBER = 4;

const ARRAYS = {
  int8: Int8Array, uint8: Uint8Array, int16: Int16Array, uint16: Uint16Array,
  int32: Int32Array, uint32: Uint32Array, int64: BigInt64Array, uint64: BigUint64Array,
  float32: Float32Array, float64: Float64Array,
} as const;

/** Least and greatest raw value of some rows, and their flags together. */
export class Extent {
  min = Infinity;
  max = -Infinity;
  flags = 0;

  clear(): void {
    this.min = Infinity;
    this.max = -Infinity;
    this.flags = 0;
  }

  add(min: number, max: number, flags: number): void {
    if (min < this.min) this.min = min;
    if (max > this.max) this.max = max;
    this.flags |= flags;
  }
}

/** The samples of one signal in a block of rows, exact in its own type. */
export class Samples {
  readonly values: Column;
  /** Greatest values of places that stand for several cycles; `values` has the least ones. */
  upper: Column | null = null;
  readonly flags = new Uint8Array(BLOCK);
  private readonly min = new Float64Array(NODES).fill(Infinity);
  private readonly max = new Float64Array(NODES).fill(-Infinity);
  private readonly any = new Uint8Array(NODES);

  constructor(readonly type: ColumnType) {
    this.values = new ARRAYS[type](BLOCK);
  }

  get bytes(): number {
    return this.values.byteLength + (this.upper?.byteLength ?? 0) + BLOCK + NODES * 17;
  }

  set(row: number, low: number | bigint, high: number | bigint, flags: number): void {
    store(this.values, row, low);
    // The rows before have one value, which is their greatest, too.
    if (high !== low && !(high !== high && low !== low)) this.upper ??= this.values.slice();
    if (this.upper) store(this.upper, row, high);
    const min = Number(low);
    const max = Number(high);
    const number = Number.isFinite(min) && Number.isFinite(max);
    if (!number) flags |= NO_NUMBER;
    this.flags[row] = flags;
    for (let node = row >> 4; ; node = node < SECOND ? SECOND + (node >> 4) : THIRD) {
      if (number) {
        if (min < this.min[node]!) this.min[node] = min;
        if (max > this.max[node]!) this.max[node] = max;
      }
      this.any[node]! |= flags;
      if (node === THIRD) break;
    }
  }

  /** Least and greatest value of the place `row`. */
  low(row: number): number {
    return Number(this.values[row]);
  }

  high(row: number): number {
    return Number((this.upper ?? this.values)[row]);
  }

  /** Adds the rows `from` to `to` (excluded) to `extent`. */
  extent(from: number, to: number, extent: Extent): void {
    const { min, max, any } = this;
    let row = from;
    while (row < to) {
      let node: number;
      let next: number;
      if ((row & 15) !== 0 || row + 16 > to) {
        const flags = this.flags[row]!;
        if (flags !== 0 && (flags & NO_NUMBER) === 0) {
          extent.add(this.low(row), this.high(row), flags);
        } else extent.flags |= flags;
        row++;
        continue;
      }
      if ((row & 255) !== 0 || row + 256 > to) {
        node = row >> 4;
        next = row + 16;
      } else if (row !== 0 || to < BLOCK) {
        node = SECOND + (row >> 8);
        next = row + 256;
      } else {
        node = THIRD;
        next = BLOCK;
      }
      extent.add(min[node]!, max[node]!, any[node]!);
      row = next;
    }
  }
}

function store(values: Column, row: number, value: number | bigint): void {
  if (values instanceof BigInt64Array || values instanceof BigUint64Array) {
    values[row] = typeof value === "bigint" ? value : BigInt(Number.isFinite(value) ? Math.round(value) : 0);
  } else values[row] = Number(value);
}
