// What the page and the worker of the scope say to each other.
import type { ColumnType } from "../protocol";
import type { Spectrum, WindowFunction } from "./spectrum";
import type { Statistics } from "./statistics";
import type { Trigger } from "./trigger";

/** A signal as it is drawn. Physical value = raw * scale + offset. */
export interface Curve {
  name: string;
  label: string;
  /** As in files of `ecatctl record`: SLAVE/ENTRY, and without the factor of the picture. */
  recorded: { path: string; scale: number; offset: number; unit: string };
  type: ColumnType;
  scale: number;
  offset: number;
  unit: string;
  values: Record<string, string>;
  colour: string;
  /** Lengths of dashes and gaps in CSS pixels; none: a solid line. */
  dash: number[];
  /** Signals with the same one share an axis. */
  axis: string;
  /** A lane of its own: booleans and named values. */
  digital: boolean;
  hidden: boolean;
  faint: boolean;
}

export interface Palette {
  background: string;
  text: string;
  faint: string;
  line: string;
  accent: string;
  error: string;
  warning: string;
}

export interface Mark {
  /** Unix time in ms. */
  time: number;
  kind: string;
  severity: string;
  text: string;
}

/** A rectangle of the picture, in CSS pixels, with the values at its lower and upper end. */
export interface Lane {
  axis: string;
  title: string;
  digital: boolean;
  names: string[];
  left: number;
  top: number;
  height: number;
  low: number;
  high: number;
}

export interface View {
  /** Unix time in ms of the left edge, and ms up to the right one. */
  start: number;
  span: number;
  live: boolean;
}

export type Format = "csv" | "mcap" | "png" | "svg";

export type Order =
  | { do: "open"; curves: OffscreenCanvas; overlay: OffscreenCanvas }
  | { do: "size"; width: number; height: number; ratio: number }
  | { do: "palette"; palette: Palette }
  | { do: "batch"; data: ArrayBuffer }
  | { do: "restart"; file: boolean }
  | { do: "types"; types: [string, ColumnType][] }
  | {
    do: "curves"; curves: Curve[]; stacked: boolean; limits: Record<string, [number, number]>;
    /** Of the wish for them. */
    generation: number;
  }
  | { do: "zoom"; factor: number; at: number }
  | { do: "pan"; part: number }
  | { do: "window"; start: number; span: number }
  | { do: "live"; span?: number }
  | { do: "all" }
  | { do: "cursors"; cursors: number[] }
  /** Moves a cursor by some cycles; a report says where it is then. */
  | { do: "step"; cursor: number; cycles: number }
  /** Unix time in ms under the pointer. */
  | { do: "hover"; time: number | null }
  | { do: "marks"; marks: Mark[] }
  | { do: "trigger"; trigger: Trigger | null }
  /** Marks what triggered an incident. */
  | { do: "moment"; time: number }
  | { do: "statistics"; on: boolean }
  | { do: "detail"; canvas: OffscreenCanvas; width: number; height: number; ratio: number }
  | { do: "look"; look: Look | null }
  | { do: "export"; format: Format; all: boolean; bus: string };

/** Whether an order is one of those that `Status.drawn` counts. */
export const counts = (order: Order) => order.do !== "batch" && order.do !== "hover";

/** What the second picture shows. */
export type Look =
  | { kind: "spectrum"; names: string[]; window: WindowFunction; decibel: boolean }
  | { kind: "xy"; x: string; y: string };

export interface Reading {
  /** Physical; for 64-bit integers without scale the exact one as text. Null: none. */
  value: number | string | null;
  /** The name of the raw value, or empty. */
  name: string;
  old: boolean;
}

export interface Status {
  is: "status";
  view: View;
  left: number;
  width: number;
  lanes: Lane[];
  /** For each curve: newest value, and those at the cursors. */
  readings: Reading[][];
  /** Numbers of the cycles at the cursors; NaN: none. */
  cycles: number[];
  /** Under the pointer: time and number of the cycle, and a reading for each curve. */
  hover: { time: number; cycle: number; readings: Reading[] } | null;
  rows: number;
  first: number;
  last: number;
  bytes: number;
  short: boolean;
  missing: number;
  pauses: number;
  minmax: boolean;
  shift: number;
  trigger: "off" | "waits" | "collects" | "holds";
  /** Mean ms of JavaScript for a frame, and frames in the last second. */
  drawing: number;
  frames: number;
  /** How many orders the picture has, so that a test knows when it stands still. */
  drawn: number;
}

export type Report =
  | Status
  | { is: "statistics"; rows: ({ name: string } & Statistics)[]; span: number }
  | { is: "spectrum"; rows: { name: string; peaks: Spectrum["peaks"]; count: number; held: number; rate: number }[] }
  | { is: "cursors"; cursors: number[] }
  | { is: "file"; blob: Blob; format: Format }
  | { is: "failure"; text: string };
