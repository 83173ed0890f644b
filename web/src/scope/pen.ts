// Draws axes the same way on a canvas and into an SVG file. Lengths are CSS pixels.

export interface Pen {
  line(x1: number, y1: number, x2: number, y2: number, colour: string, dash?: number[]): void;
  box(x: number, y: number, width: number, height: number, colour: string, alpha?: number): void;
  text(x: number, y: number, text: string, colour: string, align?: "left" | "center" | "right", bold?: boolean): void;
}

const FONT = "system-ui, sans-serif";
const SIZE = 11;

export class CanvasPen implements Pen {
  constructor(
    private readonly context: OffscreenCanvasRenderingContext2D,
    readonly ratio: number,
  ) {
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.textBaseline = "middle";
    context.font = `${SIZE}px ${FONT}`;
  }

  line(x1: number, y1: number, x2: number, y2: number, colour: string, dash: number[] = []): void {
    const { context, ratio } = this;
    const sharp = (at: number) => (Math.floor(at * ratio) + 0.5) / ratio;
    context.strokeStyle = colour;
    context.lineWidth = 1 / ratio;
    context.setLineDash(dash);
    context.beginPath();
    context.moveTo(sharp(x1), sharp(y1));
    context.lineTo(sharp(x2), sharp(y2));
    context.stroke();
  }

  box(x: number, y: number, width: number, height: number, colour: string, alpha = 1): void {
    this.context.globalAlpha = alpha;
    this.context.fillStyle = colour;
    this.context.fillRect(x, y, width, height);
    this.context.globalAlpha = 1;
  }

  text(x: number, y: number, text: string, colour: string, align: CanvasTextAlign = "left", bold = false): void {
    if (bold) this.context.font = `600 ${SIZE}px ${FONT}`;
    this.context.fillStyle = colour;
    this.context.textAlign = align;
    this.context.fillText(text, x, y);
    if (bold) this.context.font = `${SIZE}px ${FONT}`;
  }
}

export class SvgPen implements Pen {
  readonly parts: string[] = [];

  line(x1: number, y1: number, x2: number, y2: number, colour: string, dash: number[] = []): void {
    this.parts.push(
      `<line x1="${n(x1)}" y1="${n(y1)}" x2="${n(x2)}" y2="${n(y2)}" stroke="${escape(colour)}"` +
        `${dash.length ? ` stroke-dasharray="${dash.join(" ")}"` : ""}/>`,
    );
  }

  box(x: number, y: number, width: number, height: number, colour: string, alpha = 1): void {
    this.parts.push(
      `<rect x="${n(x)}" y="${n(y)}" width="${n(width)}" height="${n(height)}" ` +
        `fill="${escape(colour)}" fill-opacity="${alpha}"/>`,
    );
  }

  text(x: number, y: number, text: string, colour: string, align = "left", bold = false): void {
    const anchor = { left: "start", center: "middle", right: "end" }[align];
    this.parts.push(
      `<text x="${n(x)}" y="${n(y + SIZE * 0.35)}" fill="${escape(colour)}" text-anchor="${anchor}"` +
        `${bold ? ' font-weight="600"' : ""}>${escape(text)}</text>`,
    );
  }

  /** A path in pixels of the canvas, of which a CSS pixel has `ratio`. */
  path(path: string, colour: string, ratio: number): void {
    this.parts.push(
      `<path d="${path}" transform="scale(${1 / ratio})" fill="none" stroke="${escape(colour)}"/>`,
    );
  }

  /** The file; `width` and `height` of the picture. */
  file(width: number, height: number): string {
    return (
      `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${height}" ` +
      `viewBox="0 0 ${width} ${height}" font-family="${FONT}" font-size="${SIZE}">\n` +
      `${this.parts.join("\n")}\n</svg>\n`
    );
  }
}

const n = (value: number) => String(Math.round(value * 100) / 100);

export function escape(text: string): string {
  return text.replace(/[&<>"]/g, (c) => `&#${c.charCodeAt(0)};`);
}
