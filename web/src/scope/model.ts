// What the scope shows, and its way to the worker.
import { batch, computed, signal } from "@preact/signals";

import type { Tracer } from "../traces";
import type { BusEvent, Message, Signal } from "../protocol";
import { bitNames, bitOf, find } from "./bits";
import { colour, dash, LOOKS } from "./colours";
import { type Entry, type Layout, LayoutError, MOST_SIGNALS, readLayout, writeLayout } from "./layout";
import { counts, type Curve, type Format, type Look, type Mark, type Order, type Palette, type Report, type Status } from "./messages";
import type { Trigger } from "./trigger";

const KEPT = "ecatd scope ";
const MOST_MARKS = 2000;
const NO_SAMPLES = "No samples come: ";

/** What the rest of the page gives to the scope, and may ask of it. */
export class ScopeModel {
  readonly known = signal<Map<string, Signal>>(new Map());
  readonly entries = signal<Entry[]>([]);
  readonly stacked = signal(true);
  readonly limits = signal<Record<string, [number, number]>>({});
  readonly cursors = signal<number[]>([]);
  readonly trigger = signal<Trigger | null>(null);
  readonly status = signal<Status | null>(null);
  /** How many orders the worker has got, as `Status.drawn` counts them. */
  readonly ordered = signal(0);
  readonly statistics = signal<Extract<Report, { is: "statistics" }> | null>(null);
  readonly showsStatistics = signal(false);
  readonly look = signal<Look | null>(null);
  readonly spectra = signal<Extract<Report, { is: "spectrum" }>["rows"]>([]);
  readonly marks = signal<Mark[]>([]);
  readonly emphasised = signal<string | null>(null);
  readonly dark = signal(false);
  /** The seconds with which the newest signals began, and why they are none. */
  readonly history = signal<{ seconds: number; why: string } | null>(null);
  /** What the user should know: a failure, or what has just happened. */
  readonly notice = signal("");
  readonly link = signal<{ up: boolean; text: string } | null>(null);
  readonly source = signal<"bus" | "file">("bus");
  readonly title = signal("");
  readonly ended = signal(false);
  readonly saves = signal(false);
  readonly saving = signal(false);

  readonly curves = computed((): Curve[] => {
    const all = this.entries.value;
    const chosen = this.emphasised.value;
    return all.flatMap((entry) => {
      const it = find(this.known.value, entry.name);
      if (!it) return [];
      const named = Object.keys(it.values).length > 0;
      const isBoolean = it.bits === 1;
      return [{
        name: it.name, label: it.label, type: it.type, scale: it.scale * entry.gain,
        recorded: { path: it.path, scale: it.scale, offset: it.offset, unit: it.unit },
        offset: it.offset * entry.gain, unit: entry.gain === 1 ? it.unit : `${it.unit} × ${entry.gain}`,
        values: it.values, colour: colour(entry.colour, this.dark.value), dash: named || isBoolean ? [] : dash(entry.colour),
        axis: entry.axis || `unit ${it.unit}${entry.gain === 1 ? "" : ` × ${entry.gain}`}`,
        digital: named || isBoolean, hidden: entry.hidden,
        faint: chosen !== null && chosen !== it.name,
      }];
    });
  });

  readonly #worker = new Worker(script(), { type: "module" });
  private span = 10e3;
  #traced = "";
  #generation = 0;

  constructor(private readonly connection: Tracer) {
    this.#worker.onmessage = ({ data }: MessageEvent<Report>) => this.#hear(data);
    this.#worker.onerror = (event) => {
      this.notice.value = `The scope stopped: ${event.message}. Load the page again.`;
    };
  }

  order(order: Order, transfer: Transferable[] = []): void {
    if (counts(order)) this.ordered.value++;
    this.#worker.postMessage(order, transfer);
  }

  #hear(report: Report): void {
    if (report.is === "status") this.status.value = report;
    else if (report.is === "statistics") this.statistics.value = report;
    else if (report.is === "cursors") this.cursors.value = report.cursors;
    else if (report.is === "spectrum") this.spectra.value = report.rows;
    else if (report.is === "failure") {
      this.saving.value = false;
      this.notice.value = report.text;
    } else this.download(report.blob, report.format);
  }

  /** All signals of the bus. */
  setSignals({ signals, shown }: { signals: Signal[]; shown: string[] }): void {
    const isFirst = this.known.value.size === 0;
    this.known.value = new Map(signals.map((each) => [each.name, each]));
    this.order({ do: "types", types: signals.map(({ name, type }) => [name, type]) });
    if (isFirst && this.entries.value.length === 0) this.#restore();
    if (isFirst && this.curves.value.length === 0) for (const name of shown) this.add(name);
    this.#nameUnknown("");
    this.#send();
  }

  /** Says which of the chosen signals this bus lacks. */
  #nameUnknown(more: string): void {
    const unknown = this.entries.value.filter(({ name }) => !find(this.known.value, name));
    this.notice.value = unknown.length > 0 ? `This bus has no ${unknown.map(({ name }) => name).join(", ")}${more}.` : "";
  }

  /**
   * Draws a signal, which somebody has chosen elsewhere in the page.
   *
   * @param axis The axis that it shares; none: that of its unit.
   */
  add(name: string, axis = ""): void {
    const entries = this.entries.value;
    if (!find(this.known.value, name) || entries.some((entry) => entry.name === name)) return;
    if (entries.length >= MOST_SIGNALS) {
      this.notice.value = `The scope shows at most ${MOST_SIGNALS} signals. Remove one first.`;
      return;
    }
    const used = new Set(entries.map((entry) => entry.colour));
    let free = 0;
    while (used.has(free) && free < LOOKS) free++;
    this.entries.value = [
      ...entries,
      { name, colour: free < LOOKS ? free : entries.length, axis, gain: 1, hidden: false },
    ];
    this.#send();
  }

  /** Names of the bits of a signal that can have lanes. */
  bitsOf(name: string): string[] {
    const signal = this.known.value.get(name);
    return signal ? bitNames(signal) : [];
  }

  remove(name: string): void {
    this.entries.value = this.entries.value.filter((entry) => entry.name !== name);
    if (this.emphasised.value === name) this.emphasised.value = null;
    this.#send();
  }

  change(name: string, change: Partial<Entry>): void {
    this.entries.value = this.entries.value.map((entry) =>
      entry.name === name ? { ...entry, ...change } : entry,
    );
    this.#send();
  }

  emphasise(name: string | null): void {
    if (this.emphasised.value === name) return;
    this.emphasised.value = name;
    this.#sendCurves();
  }

  arrange(stacked: boolean): void {
    this.stacked.value = stacked;
    this.#send();
  }

  limit(axis: string, ends: [number, number] | null): void {
    const { [axis]: _, ...others } = this.limits.value;
    this.limits.value = ends ? { ...others, [axis]: ends } : others;
    this.#send();
  }

  #sendCurves(): void {
    this.order({
      do: "curves", curves: this.curves.value, stacked: this.stacked.value, limits: this.limits.value,
      generation: this.#generation,
    });
  }

  /** Tells worker and server what is shown, and keeps it. */
  #send(): void {
    const { value: known } = this.known;
    const names = this.curves.value.map(({ name }) => (known.has(name) ? name : bitOf(name)!.source));
    if (names.join("\n") !== this.#traced) {
      this.#traced = names.join("\n");
      this.#generation = this.connection.setTrace([...new Set(names)]);
    }
    this.#sendCurves();
    this.#keep();
  }

  setCursors(cursors: number[]): void {
    this.cursors.value = cursors;
    this.order({ do: "cursors", cursors });
  }

  setTrigger(trigger: Trigger | null): void {
    this.trigger.value = trigger;
    this.order({ do: "trigger", trigger });
    this.#keep();
  }

  setStatistics(on: boolean): void {
    this.showsStatistics.value = on;
    this.order({ do: "statistics", on });
  }

  setLook(look: Look | null): void {
    this.look.value = look;
    this.order({ do: "look", look });
  }

  setPalette(palette: Palette, dark: boolean): void {
    this.order({ do: "palette", palette });
    this.dark.value = dark;
    this.#sendCurves();
  }

  goLive(span?: number): void {
    if (span !== undefined) this.span = span;
    this.order(span === undefined ? { do: "live" } : { do: "live", span });
    this.#keep();
  }

  /** Shows a moment (Unix time in ms) in the middle, if it is recorded. */
  show(time: number): void {
    const { view, first = NaN, last = NaN } = this.status.value ?? {};
    if (!view || !(first <= time && time <= last)) return;
    this.order({ do: "window", start: time - view.span / 2, span: view.span });
  }

  takeBatch(data: ArrayBuffer): void {
    this.order({ do: "batch", data }, [data]);
  }

  /** Events, for the track below the curves. */
  takeEvents(events: BusEvent[]): void {
    const seen = new Set(this.marks.value.map(({ time, text }) => `${time} ${text}`));
    const marks = events
      .map(({ time_ns, event, severity, text }) => ({ time: time_ns / 1e6, kind: event, severity, text }))
      .filter(({ time, text }) => !seen.has(`${time} ${text}`));
    this.marks.value = [...this.marks.value, ...marks].slice(-MOST_MARKS);
    this.order({ do: "marks", marks: this.marks.value });
  }

  /** The way to the daemon, and the end of a file. */
  takeMessage(message: Message): void {
    if (message.type === "hello") {
      batch(() => {
        this.source.value = message.source;
        this.title.value = message.title;
        this.ended.value = false;
      });
      this.#restart();
    } else if (message.type === "link") {
      this.link.value = { up: message.up, text: message.text };
      this.#restart();
    } else if (message.type === "value" && message.key === "ro/trace") {
      const { history_s, why } = (message.value ?? {}) as { history_s?: number; why?: string };
      if (history_s !== undefined) this.history.value = { seconds: history_s, why: why ?? "" };
      else if (message.failure) this.notice.value = `${NO_SAMPLES}${message.failure.message}`;
      else if (this.notice.value.startsWith(NO_SAMPLES)) this.notice.value = "";
    } else if (message.type === "value" && message.key === "reading") {
      this.order({ do: "moment", time: message.at * 1000 });
    } else if (message.type === "end") {
      this.ended.value = true;
      // Who looks at a part of it, and chooses one more signal, sees the same part.
      if (this.status.value?.view.live !== false) this.order({ do: "all" });
    }
  }

  #restart(): void {
    this.order({ do: "restart", file: this.source.value === "file" });
  }

  save(format: Format, all: boolean): void {
    this.saving.value = true;
    this.order({ do: "export", format, all, bus: this.title.value || "ecat" });
  }

  private download(blob: Blob, format: string): void {
    this.saving.value = false;
    const time = new Date().toISOString().slice(0, 19).replaceAll(":", "-");
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = `${(this.title.value || "scope").replace(/[^\w.-]+/g, "-")}-${time}.${format}`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60e3);
  }

  #layout(): Layout {
    return {
      signals: this.entries.value, stacked: this.stacked.value, limits: this.limits.value,
      span: this.status.value?.view.live ? this.status.value.view.span : this.span,
      trigger: this.trigger.value,
    };
  }

  #keep(): void {
    try {
      localStorage.setItem(KEPT + this.title.value, writeLayout(this.#layout()));
    } catch {
      // The browser keeps nothing; the scope works without it.
    }
  }

  #restore(): void {
    let text: string | null = null;
    try {
      text = localStorage.getItem(KEPT + this.title.value);
    } catch {
      return;
    }
    if (text !== null) this.open(text);
  }

  saveLayout(): void {
    this.download(new Blob([writeLayout(this.#layout())], { type: "application/json" }), "layout.json");
  }

  /** Shows what a layout says. */
  open(text: string): void {
    try {
      const layout = readLayout(text);
      batch(() => {
        this.entries.value = layout.signals;
        this.stacked.value = layout.stacked;
        this.limits.value = layout.limits;
      });
      this.#nameUnknown("; the rest of the layout is shown");
      this.#send();
      this.goLive(layout.span);
      this.setTrigger(layout.trigger);
    } catch (error) {
      if (!(error instanceof LayoutError)) throw error;
      this.notice.value = error.message;
    }
  }
}

/** The address of the worker, as a page with Trusted Types needs it. */
function script(): string {
  const address = "scope.js";
  const types = (self as { trustedTypes?: { createPolicy(name: string, rules: object): { createScriptURL(address: string): string } } }).trustedTypes;
  return types?.createPolicy("ecatd", { createScriptURL: () => address }).createScriptURL(address) ?? address;
}
