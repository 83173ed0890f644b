// The second picture: spectrum, or one signal over another.
import { numberText, ticks } from "./axes";
import type { Curve, Look, Palette, Report } from "./messages";
import { CanvasPen } from "./pen";
import { BLOCK, NO_NUMBER } from "./pyramid";
import type { Ring } from "./ring";
import { type Spectrum, spectrum } from "./spectrum";

const LONGEST = 1 << 17;
const LEFT = 58;
const RIGHT = 12;
const TOP = 10;
const BOTTOM = 30;
/** Points of an XY picture that are joined by lines. */
const LINES = 20_000;

type SpectrumReport = Extract<Report, { is: "spectrum" }>;

export class Detail {
  #canvas: OffscreenCanvas | null = null;
  private width = 1;
  private height = 1;
  #ratio = 1;

  open(canvas: OffscreenCanvas, width: number, height: number, ratio: number): void {
    this.#canvas = canvas;
    this.#ratio = ratio;
    Object.assign(this, { width, height });
    this.#resize();
  }

  #resize(): void {
    this.#canvas!.width = Math.max(1, Math.round(this.width * this.#ratio));
    this.#canvas!.height = Math.max(1, Math.round(this.height * this.#ratio));
  }

  #begin(palette: Palette): [OffscreenCanvasRenderingContext2D, CanvasPen] {
    const context = this.#canvas!.getContext("2d")!;
    const pen = new CanvasPen(context, this.#ratio);
    pen.box(0, 0, this.width, this.height, palette.background);
    return [context, pen];
  }

  /** Frame with ticks; returns the functions from values to places. */
  #frame(
    pen: CanvasPen, palette: Palette, x: [number, number], y: [number, number], xTitle: string,
    yTitle: string,
  ): [(value: number) => number, (value: number) => number] {
    const { width, height } = this;
    const right = width - RIGHT;
    const low = height - BOTTOM;
    const toX = (value: number) => LEFT + ((value - x[0]) / (x[1] - x[0])) * (right - LEFT);
    const toY = (value: number) => low - ((value - y[0]) / (y[1] - y[0])) * (low - TOP);
    for (const value of ticks(...x, (right - LEFT) / 80)) {
      pen.line(toX(value), TOP, toX(value), low, palette.line);
      pen.text(toX(value), low + 9, numberText(value), palette.faint, "center");
    }
    for (const value of ticks(...y, (low - TOP) / 36)) {
      pen.line(LEFT, toY(value), right, toY(value), palette.line);
      pen.text(LEFT - 6, toY(value), numberText(value), palette.faint, "right");
    }
    pen.line(LEFT, TOP, LEFT, low, palette.faint);
    pen.line(LEFT, low, right, low, palette.faint);
    pen.text(right, height - 7, xTitle, palette.text, "right", true);
    pen.text(right - 6, TOP + 7, yTitle, palette.text, "right", true);
    return [toX, toY];
  }

  draw(ring: Ring, look: Look, curves: Curve[], from: number, to: number, palette: Palette): SpectrumReport | null {
    if (!this.#canvas) return null;
    if (look.kind === "xy") {
      this.#drawXY(ring, look.x, look.y, curves, from, to, palette);
      return null;
    }
    return this.#drawSpectrum(ring, look, curves, from, to, palette);
  }

  #drawSpectrum(
    ring: Ring, look: Extract<Look, { kind: "spectrum" }>, curves: Curve[], from: number, to: number, palette: Palette,
  ): SpectrumReport {
    const report: SpectrumReport = { is: "spectrum", rows: [] };
    const found: [Curve, Spectrum][] = [];
    for (const name of look.names) {
      const curve = curves.find((each) => each.name === name);
      const taken = curve && samplesOf(ring, curve, from, to);
      if (!curve || !taken) continue;
      const result = spectrum(taken.samples, taken.rate, look.window);
      found.push([curve, result]);
      report.rows.push({
        name, peaks: result.peaks, count: taken.samples.length, held: taken.held, rate: taken.rate,
      });
    }
    const level = (amplitude: number) =>
      look.decibel ? 20 * Math.log10(Math.max(amplitude, 1e-12)) : amplitude;
    let [low, high] = [Infinity, -Infinity];
    let end = 1;
    for (const [, { amplitudes, step }] of found) {
      for (let i = 1; i < amplitudes.length; i++) {
        low = Math.min(low, level(amplitudes[i]!));
        high = Math.max(high, level(amplitudes[i]!));
      }
      end = Math.max(end, step * (amplitudes.length - 1));
    }
    if (!(high > -Infinity)) [low, high] = [0, 1];
    const bottom = look.decibel ? Math.max(low, high - 120) : 0;
    const top = high + (high - bottom || 1) * 0.1;
    const units = new Set(found.map(([curve]) => curve.unit));
    const unit = look.decibel ? `dB of 1 ${[...units].join(", ")}` : [...units].join(", ");
    const [context, pen] = this.#begin(palette);
    const [x, y] = this.#frame(pen, palette, [0, end], [bottom, top], "Hz", `amplitude ${unit}`);
    for (const [curve, { amplitudes, step }] of found) {
      context.strokeStyle = curve.colour;
      context.lineWidth = 1.25;
      context.setLineDash(curve.dash);
      context.beginPath();
      // The greatest line of each column, so that no peak is lost.
      let column = -1;
      let most = -Infinity;
      for (let i = 1; i < amplitudes.length; i++) {
        const at = Math.floor(x(i * step) * 2) / 2;
        most = at === column ? Math.max(most, amplitudes[i]!) : amplitudes[i]!;
        if (Math.floor(x((i + 1) * step) * 2) / 2 !== at || i === amplitudes.length - 1) {
          context.lineTo(at, y(Math.max(bottom, level(most))));
        }
        column = at;
      }
      context.stroke();
    }
    const main = report.rows[0]?.peaks ?? [];
    for (const { frequency, amplitude } of main.slice(0, 3)) {
      pen.text(Math.max(LEFT + 34, x(frequency)), y(level(amplitude)) - 7, `${numberText(Number(frequency.toPrecision(5)))} Hz`, palette.text, "center");
    }
    return report;
  }

  #drawXY(ring: Ring, xName: string, yName: string, curves: Curve[], from: number, to: number, palette: Palette): void {
    const [a, b] = [xName, yName].map((name) => curves.find((curve) => curve.name === name));
    const [context, pen] = this.#begin(palette);
    if (!a || !b) return;
    const xs: number[] = [];
    const ys: number[] = [];
    ring.each(from, to, (block, begin, end) => {
      const [p, q] = [block.columns.get(a.name), block.columns.get(b.name)];
      if (!p || !q) return;
      for (let at = begin; at < end; at++) {
        if (!p.flags[at] || !q.flags[at] || (p.flags[at]! | q.flags[at]!) & NO_NUMBER) continue;
        xs.push(p.low(at) * a.scale + a.offset);
        ys.push(q.low(at) * b.scale + b.offset);
      }
    });
    const range = (values: number[]): [number, number] => {
      let [low, high] = [Infinity, -Infinity];
      for (const value of values) {
        low = Math.min(low, value);
        high = Math.max(high, value);
      }
      if (low > high) return [0, 1];
      const room = (high - low) * 0.06 || 1;
      return [low - room, high + room];
    };
    const title = (curve: Curve) => (curve.unit ? `${curve.label} in ${curve.unit}` : curve.label);
    const [x, y] = this.#frame(pen, palette, range(xs), range(ys), title(a), title(b));
    context.fillStyle = context.strokeStyle = b.colour;
    context.setLineDash([]);
    context.lineWidth = 1.25;
    if (xs.length <= LINES) {
      context.beginPath();
      xs.forEach((value, i) => context.lineTo(x(value), y(ys[i]!)));
      context.stroke();
      return;
    }
    // Each pixel once.
    const done = new Uint8Array(this.width * this.height);
    for (let i = 0; i < xs.length; i++) {
      const [column, line] = [Math.floor(x(xs[i]!)), Math.floor(y(ys[i]!))];
      const pixel = line * this.width + column;
      if (done[pixel]) continue;
      done[pixel] = 1;
      context.fillRect(column, line, 1.5, 1.5);
    }
  }
}

/** The last samples of a window at equal distances; missing cycles hold the value before. */
function samplesOf(
  ring: Ring, curve: Curve, from: number, to: number,
): { samples: Float64Array; rate: number; held: number } | null {
  if (to - from < 16) return null;
  const last = ring.cycle(to - 1);
  let begin = to - 1;
  while (begin > from && ring.cycle(begin - 1) < ring.cycle(begin) && last - ring.cycle(begin - 1) < LONGEST) begin--;
  const cycles = last - ring.cycle(begin) + 1;
  if (cycles < 16) return null;
  const count = 2 ** Math.floor(Math.log2(cycles));
  const samples = new Float64Array(count);
  let held = count;
  let at = 0;
  let value = NaN;
  for (let row = begin; row < to; row++) {
    const place = ring.cycle(row) - (last - count + 1);
    const each = ring.samples(curve.name, row);
    if (!each || !each.flags[row % BLOCK] || each.flags[row % BLOCK]! & NO_NUMBER) continue;
    for (; at < place; at++) samples[at] = value;
    value = each.high(row % BLOCK) * curve.scale + curve.offset;
    if (place < 0) continue;
    samples[place] = value;
    at = place + 1;
    held--;
  }
  for (; at < count; at++) samples[at] = value;
  const firstKnown = samples.find((each) => each === each);
  if (firstKnown === undefined) return null;
  for (let i = 0; samples[i] !== samples[i]; i++) samples[i] = firstKnown;
  const rate = ((cycles - 1) / (ring.time(to - 1) - ring.time(begin))) * 1000;
  return { samples, rate, held };
}
