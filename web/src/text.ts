// Numbers and times as people read them.
import type { Column, Signal } from "./protocol";

const THIN = "\u202f";

/** A whole number with its digits in groups of three. */
export function grouped(number: number): string {
  return String(Math.round(number)).replace(/\B(?=(\d{3})+(?!\d))/g, THIN);
}

export function hex(number: number, digits: number): string {
  return `0x${number.toString(16).toUpperCase().padStart(digits, "0")}`;
}

export function counted(count: number, one: string, more = `${one}s`): string {
  return `${grouped(count)} ${count === 1 ? one : more}`;
}

/** How long something has lasted, in one unit: `4 s`, `12 min`, `3 h`, `2 d`. */
export function lasting(seconds: number): string {
  if (seconds < 1) return "now";
  if (seconds < 60) return `${Math.floor(seconds)}${THIN}s`;
  if (seconds < 3600) return `${Math.floor(seconds / 60)}${THIN}min`;
  if (seconds < 86400) return `${Math.floor(seconds / 3600)}${THIN}h`;
  return `${Math.floor(seconds / 86400)}${THIN}d`;
}

/** The time of day, with the date if that is another day. */
export function clock(seconds: number, milliseconds = false): string {
  const moment = new Date(seconds * 1000);
  const two = (value: number, width = 2) => String(value).padStart(width, "0");
  const time = `${two(moment.getHours())}:${two(moment.getMinutes())}:${two(moment.getSeconds())}`;
  const day = `${moment.getFullYear()}-${two(moment.getMonth() + 1)}-${two(moment.getDate())}`;
  const fine = milliseconds ? `.${two(moment.getMilliseconds(), 3)}` : "";
  return (moment.toDateString() === new Date().toDateString() ? "" : `${day} `) + time + fine;
}

/** A time in µs with three digits and its unit. */
export function microseconds(value: number | undefined): string {
  if (value === undefined) return "–";
  if (value < 0.9995) return `${(value * 1000).toPrecision(3).replace(/\.?0+$/, "")}${THIN}ns`;
  if (value < 999.5) return `${Number(value.toPrecision(3))}${THIN}µs`;
  if (value < 999500) return `${Number((value / 1000).toPrecision(3))}${THIN}ms`;
  return `${Number((value / 1e6).toPrecision(3))}${THIN}s`;
}

/** A physical value with as many digits as one step of the raw value is worth. */
export function physical(value: number, scale: number): string {
  if (!Number.isFinite(value)) return String(value);
  const step = Math.abs(scale);
  if (Number.isInteger(scale) && Number.isInteger(value)) return grouped(value).replace(/^-/, "−");
  const digits = step > 0 && step < 1 ? Math.min(6, Math.ceil(-Math.log10(step) - 1e-9)) : 0;
  const text = step === 1 ? String(Number(value.toPrecision(7))) : value.toFixed(digits);
  return text.replace(/^-/, "−");
}

/** A raw value of a signal in words: a named value, or a physical value with its unit. */
export function shown(signal: Signal, raw: Column[number]): string {
  const name = signal.values[String(raw)];
  if (name !== undefined) return name;
  const value = Number(raw) * signal.scale + signal.offset;
  const unit = signal.unit === "" || signal.unit === "1" ? "" : `${THIN}${signal.unit}`;
  const step = signal.type.startsWith("float") && signal.scale === 1 ? 1 : signal.scale;
  return typeof raw === "bigint" && signal.scale === 1 && signal.offset === 0
    ? String(raw) + unit
    : physical(value, step) + unit;
}

/** The name of a signal without that of its slave. */
export function shortName(signal: Signal): string {
  return signal.label.split("/").slice(1).join(" / ") || signal.address;
}
