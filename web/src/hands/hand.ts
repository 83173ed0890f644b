// Outputs that the page holds by hand: the daemon lets go 250 ms after the last request for them.
import { signal } from "@preact/signals";

import { AskError, type Connection } from "../connection";
import type { Value } from "../protocol";

const RENEW_MS = 100;
/** Requests that may be on their way at a time; with more, the line is too slow to hold anything. */
const MOST_ON_THE_WAY = 2;

/** A raw value, or a text as a person types it, with or without unit. */
export type HandValue = number | string;

/** One holder of outputs. All that it holds begins and ends together. */
export class Hand {
  /** Whether it holds now, as the daemon has said. */
  readonly holds = signal(false);
  /** Why it has let go, or could not begin; empty if nobody needs to know. */
  readonly trouble = signal("");

  /** Another one for each holding, so that a late answer or release is never about the next one. */
  #writer = "";
  #values = new Map<string, HandValue>();
  #changed = new Set<string>();
  #timer: number | undefined;
  /** What lets this page begin; null: it is still on its way; "": it has begun. */
  #ticket: string | null = null;
  #onTheWay = 0;

  constructor(private readonly connection: Pick<Connection, "ask">) {
    // A page that is not seen is not looked after: its timers become slow as well.
    document.addEventListener("visibilitychange", () => document.hidden && this.release());
    addEventListener("pagehide", () => this.release());
    addEventListener("blur", () => this.isDeadMan && this.release());
  }

  /** Whether it ends as soon as the window loses the keyboard. */
  isDeadMan = false;

  /** Holds these outputs from now on, and no others. */
  hold(values: Iterable<[string, HandValue]>): void {
    const wanted = new Map(values);
    for (const [name, value] of wanted) {
      if (this.#values.get(name) !== value) this.#changed.add(name);
    }
    this.#values = wanted;
    if (this.#timer === undefined) {
      this.#writer = crypto.randomUUID();
      this.#ticket = null;
      this.trouble.value = "";
      this.#changed = new Set(wanted.keys());
      this.#timer = setInterval(() => this.#renew(), RENEW_MS);
      this.#begin();
    } else this.#renew();
  }

  /** Lets go at once. The outputs take their safe values. */
  release(): void {
    if (this.#timer === undefined) return;
    this.#stop("");
    this.connection.ask(`rw/outputs/release/${this.#writer}`).catch(() => undefined);
  }

  get isHolding(): boolean {
    return this.#timer !== undefined;
  }

  /** Nothing moves before the daemon has answered, so nothing moves late: see `HoldOutputs`. */
  #begin(): void {
    const writer = this.#writer;
    const isMine = () => this.#timer !== undefined && this.#writer === writer;
    this.connection
      .ask(`rw/outputs/hold/${writer}`, {}, { values: Object.fromEntries(this.#values), begin: true })
      .then(
        ({ ticket }) => {
          if (!isMine()) return;
          this.#ticket = ticket as string;
          this.#renew();
        },
        (error: unknown) => {
          if (isMine()) this.#stop(sentence(error));
        },
      );
  }

  #renew(): void {
    if (this.#timer === undefined || this.#ticket === null || this.#onTheWay >= MOST_ON_THE_WAY) return;
    const writer = this.#writer;
    const payload: Value = {
      values: Object.fromEntries(
        [...this.#values].map(([name, value]) => [name, this.#changed.has(name) ? value : null]),
      ),
    };
    if (this.#ticket !== "") payload["ticket"] = this.#ticket;
    this.#ticket = "";
    this.#changed.clear();
    this.#onTheWay++;
    this.connection
      .ask(`rw/outputs/hold/${writer}`, {}, payload)
      .then(
        () => {
          if (this.#timer !== undefined && this.#writer === writer) this.holds.value = true;
        },
        (error: unknown) => {
          if (this.#timer !== undefined && this.#writer === writer) this.#stop(sentence(error));
        },
      )
      .finally(() => this.#onTheWay--);
  }

  #stop(why: string): void {
    clearInterval(this.#timer);
    this.#timer = undefined;
    this.#values.clear();
    this.#changed.clear();
    this.holds.value = false;
    if (why !== "") this.trouble.value = why;
  }
}

function sentence(error: unknown): string {
  if (!(error instanceof AskError)) return String(error);
  return error.failure.name === "lease"
    ? "The outputs were let go, since no renewal came within 250 ms. Press again to go on."
    : error.message;
}
