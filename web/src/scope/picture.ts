// The picture of the curves: which time it shows, and what of it is to be drawn.
import { drawAxes, layOut, type Plot } from "./axes";
import { drawColumns, drawPoints, eachColumn, type Grid, isLeftOut, place, rowsOf, thickness } from "./draw";
import type { Curve, Lane, Mark, Palette, View } from "./messages";
import { CanvasPen, type Pen, SvgPen } from "./pen";
import { PAUSE, type Ring } from "./ring";

const SHORTEST = 0.05; // ms
const LONGEST = 7 * 864e5;
/** ms between fits of the axes to all that a live window shows. */
const FIT = 500;

const hasNames = (curve: Curve) => curve.digital && Object.keys(curve.values).length > 0;

export class Picture {
  curves: Curve[] = [];
  stacked = true;
  limits: Record<string, [number, number]> = {};
  marks: Mark[] = [];
  cursors: number[] = [];
  trigger: number | null = null;
  hover: number | null = null;
  palette: Palette = {
    background: "#fff", text: "#222", faint: "#666", line: "#ddd", accent: "#06c",
    error: "#c00", warning: "#a60",
  };
  live = true;
  plot: Plot = { left: 0, width: 1, bottom: 1, lanes: [] };
  private span = 10e3;
  /** The right edge: the first column that is not shown. */
  #edge = 0;
  private width = 1;
  private height = 1;
  private ratio = 1;
  #curvesCanvas: OffscreenCanvas | null = null;
  #overlay: OffscreenCanvas | null = null;
  /** What the canvas has: the grid and lanes of its columns, and the first row that it lacks. */
  private drawn: { grid: Grid; lanes: Lane[]; left: number; end: number } | null = null;
  /** For each signal with named values the one raw value of each column; NaN: none, or several. */
  #named = new Map<string, Float64Array>();
  /** When the axes were fitted to all that the window shows, in ms. */
  #fitted = 0;

  constructor(private readonly ring: Ring) {}

  open(curves: OffscreenCanvas, overlay: OffscreenCanvas): void {
    this.#curvesCanvas = curves;
    this.#overlay = overlay;
    this.size(this.width, this.height, this.ratio);
  }

  size(width: number, height: number, ratio: number): void {
    const view = this.view;
    Object.assign(this, { width: Math.max(1, width), height: Math.max(1, height), ratio });
    this.drawn = null;
    this.#arrange();
    this.show(view.start, view.span, this.live);
  }

  /** All is to be drawn anew. */
  spoil(): void {
    this.drawn = null;
  }

  get #columns(): number {
    return Math.max(1, Math.round(this.plot.width * this.ratio));
  }

  private get step(): number {
    return this.span / this.#columns;
  }

  get view(): View {
    return { start: (this.#edge - this.#columns) * this.step, span: this.span, live: this.live };
  }

  /** Shows a window of time. */
  show(start: number, span: number, live = false): void {
    this.span = Math.min(LONGEST, Math.max(SHORTEST, span));
    this.live = live;
    this.#edge = Math.round(start / this.step) + this.#columns;
    if (live) this.#follow();
  }

  #follow(): void {
    this.#edge = Math.floor((this.ring.lastTime || Date.now()) / this.step) + 1;
  }

  zoom(factor: number, at: number): void {
    const { start, span } = this.view;
    const longer = Math.min(LONGEST, Math.max(SHORTEST, span * factor));
    if (this.live && at > 0.98) this.show(0, longer, true);
    else this.show(start + (span - longer) * at, longer);
  }

  pan(part: number): void {
    const { start, span } = this.view;
    const latest = this.ring.lastTime - span * 0.1;
    this.show(Math.min(start + part * span, latest || start), span);
  }

  /** Shows all that is kept. */
  all(): void {
    const { firstTime, lastTime } = this.ring;
    if (lastTime > firstTime) this.show(firstTime, (lastTime - firstTime) * 1.001);
  }

  private grid(): Grid {
    return { step: this.step, from: this.#edge - this.#columns, count: this.#columns };
  }

  #arrange(): void {
    const { start, span } = this.view;
    const { ring, drawn } = this;
    const to = ring.end > 0 ? ring.rowAt(start + span) : 0;
    // Between two looks at the whole window, those that have come can only make axes grow.
    const now = performance.now();
    const grows = this.live && drawn !== null && drawn.end >= ring.first && now - this.#fitted < FIT;
    if (!grows) this.#fitted = now;
    const from = grows ? drawn.end : ring.end > 0 ? ring.rowAt(start) : 0;
    this.plot = layOut(
      this.curves, this.stacked, this.width, this.height, this.limits, this.plot.lanes, ring,
      from, to, grows,
    );
  }

  /** Fits the canvases just before they are drawn, since that makes them black. */
  #fit(): void {
    const width = Math.max(1, Math.round(this.width * this.ratio));
    const height = Math.max(1, Math.round(this.height * this.ratio));
    for (const canvas of [this.#curvesCanvas!, this.#overlay!]) {
      if (canvas.width === width && canvas.height === height) continue;
      canvas.width = width;
      canvas.height = height;
      this.drawn = null;
    }
  }

  /** Draws what is new. */
  draw(): void {
    if (!this.#curvesCanvas || !this.#overlay) return;
    this.#fit();
    const before = this.#columns;
    const view = this.view;
    if (this.live) this.#follow();
    this.#arrange();
    if (this.#columns !== before) this.show(view.start, view.span, this.live);
    this.#drawCurves(this.#curvesCanvas.getContext("2d", { alpha: false })!);
    const context = this.#overlay.getContext("2d")!;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, this.#overlay.width, this.#overlay.height);
    this.#drawFrame(new CanvasPen(context, this.ratio));
  }

  #drawCurves(context: OffscreenCanvasRenderingContext2D): void {
    const { ring, ratio } = this;
    const grid = this.grid();
    const { width, height } = context.canvas;
    const left = Math.round(this.plot.left * ratio);
    const { lanes } = this.plot;
    const old = this.drawn;
    const shift = old ? grid.from - old.grid.from : 0;
    const sparse = this.#isSparse(grid);
    const keeps =
      !sparse && old !== null && old.left === left && old.lanes.length === lanes.length &&
      old.grid.step === grid.step && old.grid.count === grid.count && shift >= 0 &&
      shift < grid.count && old.end >= ring.first &&
      lanes.every((lane, i) => this.#lies(lane, old.lanes[i]!));
    let begin = 0;
    if (keeps) {
      if (shift > 0) {
        context.globalCompositeOperation = "copy";
        context.drawImage(context.canvas, -shift, 0);
        context.globalCompositeOperation = "source-over";
      }
      // The last column was not full, or the canvas has nothing of the rows that have come.
      const row = Math.max(ring.first, Math.min(old.end - 1, ring.end - 1));
      const column = ring.end > 0 ? Math.floor(ring.time(row) / grid.step) - grid.from : 0;
      begin = Math.max(0, Math.min(column, grid.count - shift));
    }
    context.globalAlpha = 1;
    context.fillStyle = this.palette.background;
    context.fillRect(keeps ? left + begin : 0, 0, width, height);
    if (keeps) context.fillRect(0, 0, left, height);
    if (ring.end > 0) {
      const part = { ...grid, from: grid.from + begin, count: grid.count - begin };
      const rows = begin < grid.count ? rowsOf(ring, part) : new Float64Array(0);
      let all: Float64Array | null = null;
      lanes.forEach((lane, i) => {
        const was = keeps ? old.lanes[i]! : lane;
        const isNew = was.low !== lane.low || was.high !== lane.high;
        if (isNew) this.#clear(context, lane, left);
        const shown = isNew ? (all ??= rowsOf(ring, grid)) : rows;
        for (const curve of this.#curvesOf(lane.names)) {
          if (sparse && !lane.digital) drawPoints(context, ring, curve, lane, grid, left, ratio);
          else {
            const at = isNew ? 0 : begin;
            drawColumns(context, ring, curve, lane, shown, grid.from + at, left + at, ratio);
          }
          if (hasNames(curve)) this.#readNames(curve.name, rows, grid.count, keeps ? shift : grid.count);
        }
      });
    }
    // Points of lines may lie outside of the window.
    if (sparse) {
      context.fillStyle = this.palette.background;
      context.fillRect(0, 0, left, height);
      context.fillRect(left + grid.count, 0, width, height);
    }
    this.drawn = sparse ? null : { grid, lanes, left, end: ring.end };
  }

  /** Whether a lane is where it was, with the same values unless it can be drawn anew alone. */
  #lies(lane: Lane, was: Lane): boolean {
    const isAlone = this.stacked || lane.digital || this.plot.lanes.length === 1;
    return lane.axis === was.axis && lane.left === was.left && lane.top === was.top &&
      lane.height === was.height && (isAlone || (lane.low === was.low && lane.high === was.high));
  }

  /** Takes the curves of a lane away. */
  #clear(context: OffscreenCanvasRenderingContext2D, lane: Lane, left: number): void {
    const { ratio } = this;
    const top = Math.round(lane.top * ratio) - 1;
    const bottom = Math.round((lane.top + lane.height) * ratio) + 1 + thickness(ratio);
    context.globalAlpha = 1;
    context.fillStyle = this.palette.background;
    context.fillRect(left, top, context.canvas.width, bottom - top);
  }

  #curvesOf(names: string[]): Curve[] {
    const all = this.curves.filter((curve) => names.includes(curve.name));
    // What is emphasised lies above.
    return [...all.filter((curve) => curve.faint), ...all.filter((curve) => !curve.faint)];
  }

  #isSparse({ step, from, count }: Grid): boolean {
    if (this.ring.end === 0) return false;
    const rows = this.ring.rowAt((from + count) * step) - this.ring.rowAt(from * step);
    return rows * 3 < count;
  }

  #drawFrame(pen: Pen): void {
    drawAxes(
      pen, this.plot, this.view, this.palette, this.curves, this.marks, this.cursors, this.trigger,
    );
    this.#drawHover(pen);
    this.#drawGaps(pen);
    this.#drawNames(pen);
  }

  #drawHover(pen: Pen): void {
    const { start, span } = this.view;
    if (this.hover === null || this.hover < start || this.hover > start + span) return;
    const x = this.plot.left + ((this.hover - start) / span) * this.plot.width;
    pen.line(x, 0, x, this.plot.bottom, this.palette.faint);
  }

  /** Columns without cycles, in the track of events. */
  #drawGaps(pen: Pen): void {
    const { ring, plot } = this;
    if (ring.missing + ring.pauses === 0) return;
    const { start, span } = this.view;
    const x = (time: number) => plot.left + ((time - start) / span) * plot.width;
    const to = Math.min(ring.end - 1, ring.rowAt(start + span));
    let last = -1;
    for (const row of ring.gaps(ring.rowAt(start), to)) {
      const from = x(row > ring.first ? ring.time(row - 1) : ring.time(row));
      const end = Math.max(x(ring.time(row)), from + 1);
      if (Math.floor(end) === last) continue;
      last = Math.floor(end);
      const begin = Math.max(plot.left, from);
      const colour = ring.rowFlags(row) & PAUSE ? this.palette.faint : this.palette.error;
      pen.box(begin, plot.bottom - 3, end - begin, 3, colour);
      if (end - begin > 3) pen.box(begin, 8, end - begin, plot.bottom - 8, colour, 0.08);
    }
  }

  /** Names of values, in the lanes of signals that have them. */
  #drawNames(pen: Pen): void {
    for (const lane of this.plot.lanes) {
      const [curve] = this.#curvesOf(lane.names);
      if (!lane.digital || !curve || !hasNames(curve)) continue;
      const columns = this.#named.get(curve.name) ?? [];
      let begin = 0;
      for (let column = 1; column <= columns.length; column++) {
        const value = columns[begin]!;
        if (columns[column] === value) continue;
        const text = curve.values[value] ?? "";
        const width = (column - begin) / this.ratio;
        if (text !== "" && width > text.length * 6.5 + 8) {
          const y = lane.top + ((lane.high - (value * curve.scale + curve.offset)) /
            (lane.high - lane.low)) * lane.height;
          const above = y > lane.top + lane.height / 2;
          pen.text(this.plot.left + begin / this.ratio + 5, above ? y - 7 : y + 8, text, this.palette.text);
        }
        begin = column;
      }
    }
  }

  /** Reads the values of the last columns; the others move by `shift`. */
  #readNames(name: string, rows: Float64Array, count: number, shift: number): void {
    let columns = this.#named.get(name);
    if (columns?.length !== count) this.#named.set(name, (columns = new Float64Array(count).fill(NaN)));
    const begin = count - Math.max(0, rows.length - 1);
    columns.copyWithin(0, shift);
    columns.fill(NaN, begin);
    eachColumn(this.ring, name, rows, (column, min, max) => {
      columns[begin + column] = min === max ? max : NaN;
    });
  }

  /** The picture as a PNG file. */
  png(): Promise<Blob> {
    const canvas = new OffscreenCanvas(this.#curvesCanvas!.width, this.#curvesCanvas!.height);
    const context = canvas.getContext("2d")!;
    context.drawImage(this.#curvesCanvas!, 0, 0);
    context.drawImage(this.#overlay!, 0, 0);
    return canvas.convertToBlob({ type: "image/png" });
  }

  /** The picture as an SVG file: each curve a path of the least and greatest values. */
  svg(): Blob {
    const pen = new SvgPen();
    pen.box(0, 0, this.width, this.height, this.palette.background);
    const { ratio } = this;
    const grid = this.grid();
    const rows = rowsOf(this.ring, grid);
    const left = Math.round(this.plot.left * ratio);
    for (const lane of this.plot.lanes) {
      for (const curve of this.#curvesOf(lane.names)) {
        const parts: string[] = [];
        eachColumn(this.ring, curve.name, rows, (column, min, max) => {
          const a = place(lane, min * curve.scale + curve.offset, ratio);
          const b = place(lane, max * curve.scale + curve.offset, ratio);
          if (isLeftOut(curve, grid.from + column, Math.abs(a - b), ratio)) return;
          parts.push(`M${left + column + 0.5} ${Math.min(a, b)}V${Math.max(a, b) + thickness(ratio)}`);
        });
        pen.path(parts.join(""), curve.colour, ratio);
      }
    }
    this.#drawFrame(pen);
    return new Blob([pen.file(this.width, this.height)], { type: "image/svg+xml" });
  }
}
