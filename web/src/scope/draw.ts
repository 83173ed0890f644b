// Curves. Each column of pixels shows the values of its cycles, from the least to the greatest,
// and the value that is held at its begin: no peak is lost at any zoom.
import { isGap } from "./colours";
import type { Curve, Lane } from "./messages";
import { BLOCK, Extent, OLD } from "./pyramid";
import { GAP, type Ring } from "./ring";

/** Columns of pixels: column `k` shows the times from `k * step` ms up to `(k + 1) * step`. */
export interface Grid {
  step: number;
  /** The first column, and how many. */
  from: number;
  count: number;
}

/** First rows of the columns, and behind the last one the end. */
export function rowsOf(ring: Ring, { step, from, count }: Grid): Float64Array {
  const rows = new Float64Array(count + 1);
  let row = ring.first;
  for (let column = 0; column <= count; column++) {
    row = ring.rowAt((from + column) * step, row);
    if (row === ring.end) return rows.fill(row, column);
    rows[column] = row;
  }
  return rows;
}

/** Calls `show` for each column with values: raw, the least and the greatest, and flags. */
export function eachColumn(
  ring: Ring, name: string, rows: Float64Array,
  show: (column: number, min: number, max: number, flags: number) => void,
): void {
  const extent = new Extent();
  for (let column = 0; column + 1 < rows.length; column++) {
    const from = rows[column]!;
    const to = rows[column + 1]!;
    if (from >= ring.end) return;
    extent.clear();
    if (from < to) ring.extent(name, from, to, extent);
    const before = from - 1;
    if (before >= ring.first && !(ring.rowFlags(from) & GAP)) {
      const samples = ring.samples(name, before);
      const at = before % BLOCK;
      const flags = samples?.flags[at] ?? 0;
      if (samples && flags !== 0 && flags <= OLD && ring.flags(name, from) !== 0) {
        const value = samples.high(at);
        extent.add(value, value, from < to ? 0 : flags);
      }
    }
    if (extent.min <= extent.max) show(column, extent.min, extent.max, extent.flags);
  }
}

/** Place in pixels of a physical value, from the top of the picture. */
export function place(lane: Lane, value: number, ratio: number): number {
  const part = (lane.high - value) / (lane.high - lane.low);
  return Math.round((lane.top + part * lane.height) * ratio);
}

/** Thickness of curves in pixels. */
export const thickness = (ratio: number) => Math.max(1, Math.round(1.4 * ratio));

type Context = OffscreenCanvasRenderingContext2D;

/** Whether a column of a dashed curve is left out. Where a curve is steep, nothing is: no peak is lost. */
export function isLeftOut(curve: Curve, column: number, height: number, ratio: number): boolean {
  return height < 4 * ratio && isGap(curve.dash, column / ratio);
}

/** Draws columns of a curve; `first`: number of the first one, `left`: its pixel. */
export function drawColumns(
  context: Context, ring: Ring, curve: Curve, lane: Lane, rows: Float64Array, first: number,
  left: number, ratio: number,
): void {
  const thick = thickness(ratio);
  const alpha = curve.faint ? 0.25 : 1;
  const top = Math.round(lane.top * ratio);
  const bottom = Math.round((lane.top + lane.height) * ratio);
  context.fillStyle = curve.colour;
  eachColumn(ring, curve.name, rows, (column, min, max, flags) => {
    const a = place(lane, min * curve.scale + curve.offset, ratio);
    const b = place(lane, max * curve.scale + curve.offset, ratio);
    const high = Math.max(top - 1, Math.min(a, b));
    const low = Math.min(bottom + 1, Math.max(a, b));
    if (low < high || isLeftOut(curve, first + column, low - high, ratio)) return;
    context.globalAlpha = flags & OLD ? alpha * 0.4 : alpha;
    context.fillRect(left + column, high, 1, low - high + thick);
  });
  context.globalAlpha = 1;
}

/** Draws few samples as points and straight lines. */
export function drawPoints(
  context: Context, ring: Ring, curve: Curve, lane: Lane, grid: Grid, left: number, ratio: number,
): void {
  const from = Math.max(ring.first, ring.rowAt(grid.from * grid.step) - 1);
  const to = Math.min(ring.end, ring.rowAt((grid.from + grid.count) * grid.step) + 1);
  const dots = (to - from) * 6 * ratio < grid.count;
  const size = Math.round(4 * ratio);
  context.fillStyle = context.strokeStyle = curve.colour;
  context.lineWidth = 1.5 * ratio;
  context.lineJoin = "round";
  context.setLineDash(curve.dash.map((length) => length * ratio));
  context.globalAlpha = curve.faint ? 0.25 : 1;
  context.beginPath();
  let pen = false;
  for (let row = from; row < to; row++) {
    const samples = ring.samples(curve.name, row);
    const flags = samples?.flags[row % BLOCK] ?? 0;
    if (!samples || flags === 0 || flags > OLD) {
      pen = false;
      continue;
    }
    const x = left + ring.time(row) / grid.step - grid.from;
    const y = place(lane, samples.high(row % BLOCK) * curve.scale + curve.offset, ratio);
    const low = place(lane, samples.low(row % BLOCK) * curve.scale + curve.offset, ratio);
    if (pen && !(ring.rowFlags(row) & GAP)) context.lineTo(x, y);
    else context.moveTo(x, y);
    if (low !== y) context.lineTo(x, low);
    pen = true;
    if (dots) context.fillRect(Math.round(x - size / 2), Math.round(y - size / 2), size, size);
  }
  context.stroke();
  context.globalAlpha = 1;
}
