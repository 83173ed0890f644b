// What the server has sent, and what the user has chosen. Components read it; nothing else keeps it.
import { computed, effect, signal, type Signal as Cell } from "@preact/signals";

import type { Connection, Login } from "./connection";
import type { Bus, Configuration, Errors, Info, Outputs, Reading as FirstReading, States, Statistics, Worst } from "./maps";
import type { BusEvent, Failure, Lamp, Message, Rights, Signal } from "./protocol";
import { LiveValues } from "./live";
import type { ScopeModel } from "./scope/scope";
import type { FileTransfer } from "./slave/foe";
import { lasting } from "./text";
import type { Traces } from "./traces";

export type Tab = "slave" | "drive" | "outputs" | "timing" | "events";
export const TABS: readonly Tab[] = ["slave", "drive", "outputs", "timing", "events"];
export type Part = "now" | "objects" | "setup" | "health" | "files" | "memory";
export const PARTS: readonly Part[] = ["now", "objects", "setup", "health", "files", "memory"];
export type Theme = "auto" | "light" | "dark";

const MOST_EVENTS = 2000;
/** Statistics that are kept for the histograms of the last minutes: how far apart, how long. */
const READING_S = 2;
const READINGS_S = 310;
const THEME = "ecatd-theme";

interface Answers {
  "ro/slaves": Bus;
  "ro/info": Info;
  "ro/stats": Statistics;
  "ro/state": States;
  "ro/errors": Errors;
  "ro/outputs": Outputs;
  "ro/config": Configuration;
  reading: FirstReading;
  worst: Worst;
}

/** Statistics, and when they came. */
export interface Reading {
  at: number;
  statistics: Statistics;
}

interface Answer<T> {
  value: T | null;
  failure: Failure | null;
  at: number;
}

export class State {
  readonly connected = signal<"opening" | "open" | "lost" | "refused">("opening");
  /** How to come in, while `connected` is "refused". */
  readonly login = signal<Login>({ by: "token", message: "" });
  readonly hello = signal<Rights & { title: string; version: string; source: "bus" | "file" }>({
    title: "", version: "", source: "bus", may: [], user: "", buses: [],
  });
  readonly link = signal({ up: true, text: "", since: 0 });
  readonly signals = signal<Signal[]>([]);
  readonly lamps = signal<Lamp[]>([]);
  /** The newest one first. */
  readonly events = signal<BusEvent[]>([]);
  readonly leftOut = signal(0);
  /** Unix time in seconds, each second; of an incident, the time of its values. */
  readonly now = signal(Date.now() / 1000);
  readonly lostAt = signal(0);

  readonly tab = signal<Tab>("slave");
  readonly part = signal<Part>("now");
  readonly selected = signal<number | null>(null);
  readonly theme = signal<Theme>((localStorage.getItem(THEME) as Theme | null) ?? "auto");
  readonly help = signal(false);

  /** The oldest first. */
  readonly readings = signal<Reading[]>([]);
  readonly hidesReading = signal(false);
  /** The last file of each slave: it goes on while the panel shows something else. */
  readonly transfers = signal<ReadonlyMap<number, FileTransfer>>(new Map());

  #moment: number | null = null;
  #choseTab = false;
  readonly #answers = new Map<string, Cell<Answer<unknown>>>();

  /** Whether the values are of now: the page hears the server, and this hears the daemon. */
  readonly fresh = computed(() => this.connected.value === "open" && this.link.value.up);
  readonly bus = computed(() => this.of("ro/slaves").value.value);
  readonly states = computed(() => this.of("ro/state").value.value);
  readonly bySlave = computed(() => {
    const found = new Map<number, Signal[]>();
    for (const item of this.signals.value) {
      const list = found.get(item.slave);
      if (list === undefined) found.set(item.slave, [item]);
      else list.push(item);
    }
    return found;
  });
  readonly byName = computed(() => new Map(this.signals.value.map((item) => [item.name, item])));

  /** Of the signals of the slave that the panel shows. */
  readonly live: LiveValues;

  constructor(readonly connection: Connection, traces: Traces, readonly scope: ScopeModel) {
    this.live = new LiveValues(traces);
    setInterval(() => (this.now.value = this.#moment ?? Date.now() / 1000), 1000);
    this.#readFragment();
    addEventListener("hashchange", () => this.#readFragment());
    effect(() => this.#writeFragment());
    effect(() => void (document.title = this.title()));
    effect(() => {
      localStorage.setItem(THEME, this.theme.value);
      document.documentElement.dataset["theme"] = this.theme.value;
    });
  }

  /** The last answer to a query that the server watches. */
  of<K extends keyof Answers>(key: K): Cell<Answer<Answers[K]>> {
    let cell = this.#answers.get(key);
    if (cell === undefined) {
      cell = signal<Answer<unknown>>({ value: null, failure: null, at: 0 });
      this.#answers.set(key, cell);
    }
    return cell as Cell<Answer<Answers[K]>>;
  }

  /** How long before now a moment was; in an incident, how far from its trigger. */
  ago(seconds: number): string {
    const past = this.now.value - seconds;
    if (this.#moment === null) return past < 1 ? "now" : `${lasting(past)} ago`;
    return Math.abs(past) < 1 ? "at the trigger" : `${lasting(Math.abs(past))} ${past > 0 ? "before" : "after"} the trigger`;
  }

  /** What is said where the slaves would be, while they are not known. */
  nothing(): string {
    return this.hello.value.source === "file" ? "The file does not describe the bus." : "Nothing is known of the bus yet.";
  }

  may(right: string): boolean {
    return this.hello.value.may.includes(right);
  }

  take(message: Message): void {
    switch (message.type) {
      case "hello":
        this.hello.value = message;
        this.#moment = null;
        break;
      case "rights":
        this.hello.value = { ...this.hello.value, ...message };
        break;
      case "link":
        this.link.value = message;
        break;
      case "signals":
        this.signals.value = message.signals;
        break;
      case "lamps":
        this.lamps.value = message.lamps;
        break;
      case "events":
        this.#takeEvents(message.events, message.left_out);
        break;
      case "value": {
        const cell = this.of(message.key as keyof Answers) as Cell<Answer<unknown>>;
        // What failed leaves the last value, which the page shows as old.
        const value = message.value ?? cell.value.value;
        cell.value = { value, failure: message.failure ?? null, at: message.at };
        if (message.key === "reading") this.#takeReading(message.at);
        if (message.key === "ro/stats" && message.value !== null) this.#keepStatistics(message.value as unknown as Statistics, message.at);
      }
    }
  }

  takeConnected(state: "open" | "lost" | "refused", login?: Login, heard = Date.now()): void {
    if (login !== undefined) this.login.value = login;
    if (this.connected.value === "open" && state !== "open") this.lostAt.value = heard / 1000;
    this.connected.value = state;
  }

  /** The bus and its worst lamp, for those who see only the tab. */
  private title(): string {
    const lamps = this.lamps.value;
    const worst = lamps.find((lamp) => lamp.state === "bad") ?? lamps.find((lamp) => lamp.state === "warning");
    const sign = !this.fresh.value ? "✕ No connection · " : worst === undefined ? "" : `${worst.state === "bad" ? "■" : "▲"} ${worst.title} · `;
    return `${sign}${this.hello.value.title || "ecatd"}`;
  }

  /** Opens a slave in the panel. */
  open(slave: number): void {
    this.selected.value = slave;
    this.tab.value = "slave";
  }

  /** Names of the slave for people. */
  slaveName(position: number): string {
    const slave = this.bus.value?.slaves[position];
    return slave === undefined ? `slave ${position}` : slave.given_name || slave.name || `slave ${position}`;
  }

  #keepStatistics(statistics: Statistics, at: number): void {
    const kept = this.readings.value.filter((item) => item.statistics.instance === statistics.instance && item.at > at - READINGS_S);
    // The newest one always; it stays if it is far enough from the one before.
    if (kept.length > 1 && kept.at(-1)!.at - kept.at(-2)!.at < READING_S) kept.pop();
    this.readings.value = [...kept, { at, statistics }];
  }

  #takeEvents(events: BusEvent[], leftOut: number): void {
    const key = (item: BusEvent) => `${String(item["instance"])}/${item.sequence}`;
    const known = new Set(this.events.value.map(key));
    const fresh = events.filter((item) => !known.has(key(item)));
    this.events.value = [...fresh, ...this.events.value]
      .sort((a, b) => b.time_ns - a.time_ns || b.sequence - a.sequence)
      .slice(0, MOST_EVENTS);
    if (leftOut > 0) this.leftOut.value = leftOut;
  }

  /** An incident begins with what has happened, unless the address of the page names a tab. */
  #takeReading(at: number): void {
    this.now.value = this.#moment = at;
    if (!this.#choseTab) this.tab.value = "events";
    this.#choseTab = true;
  }

  #readFragment(): void {
    const found = new URLSearchParams(location.hash.slice(1));
    const tab = found.get("tab") as Tab;
    const part = found.get("part") as Part;
    const slave = found.get("slave");
    if (TABS.includes(tab)) {
      this.tab.value = tab;
      this.#choseTab = true;
    }
    if (PARTS.includes(part)) this.part.value = part;
    if (slave !== null && /^\d+$/.test(slave)) this.selected.value = Number(slave);
  }

  #writeFragment(): void {
    const parts = new URLSearchParams({ tab: this.tab.value });
    if (this.selected.value !== null) parts.set("slave", String(this.selected.value));
    if (this.part.value !== "now") parts.set("part", this.part.value);
    // The fragment holds the token until `Connection.open` has taken it out.
    if (!location.hash.includes("token=")) history.replaceState(null, "", `#${parts.toString()}`);
  }
}
