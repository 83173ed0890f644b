// A file on its way from or to a slave (FoE). The daemon carries it out; the page sends and takes it
// in parts, one after the other, so that nothing else has to wait.
import { signal } from "@preact/signals";

import { AskError, type Connection } from "../connection";
import type { Transfer } from "../maps";
import type { Value } from "../protocol";
import { bytesOf } from "./coe";

/** Bytes in one request or answer, and of the largest file, as daemon/ecatd/operations has them. */
const PART = 32 * 1024;
export const FILE_MAX = 64 * 1024 * 1024;
const PAUSES_MS = [50, 500] as const;
/** Requests in a row that may find no way to the daemon. */
const MOST_LOST = 20;
const LOST_PAUSE_MS = 1000;

export interface Request {
  file: string;
  password: number;
  boot: boolean;
}

/** How far it is: what happens, bytes of how many, and what a busy slave says. */
export interface Progress {
  step: Transfer["step"] | "fetching";
  moved: number;
  size: number | null;
  busy: string;
  seconds: number;
}

function hexOf(bytes: Uint8Array): string {
  let text = "";
  for (const byte of bytes) text += byte.toString(16).padStart(2, "0");
  return text;
}

const pause = (ms: number) => new Promise((resolve) => setTimeout(resolve, ms));

export class FileTransfer {
  readonly progress = signal<Progress | null>(null);
  readonly error = signal<unknown>(null);
  /** A remark of the daemon about the end. */
  readonly note = signal("");
  /** The file, after it was read. */
  readonly content = signal<Uint8Array | null>(null);
  /** Bytes that were moved, after the end. */
  readonly moved = signal<number | null>(null);

  readonly #begun = performance.now();
  #number: number | null = null;
  #cancelled = false;

  /** @param data What is written; null reads. */
  constructor(private readonly connection: Pick<Connection, "ask">, slave: number, readonly request: Request, readonly data: Uint8Array | null) {
    void this.#run(slave);
  }

  get isUnderWay(): boolean {
    return this.progress.value !== null;
  }

  /** Ends it. What the slave does with a part of a file depends on the slave. */
  async cancel(): Promise<void> {
    this.#cancelled = true;
    if (this.#number !== null) await this.connection.ask(`rw/foe/${this.#number}/cancel`).catch((error: unknown) => (this.error.value = error));
  }

  async #run(slave: number): Promise<void> {
    const { data, request } = this;
    try {
      this.#show("receiving", 0);
      const about: Value = { ...request };
      if (data !== null) {
        const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", data as BufferSource));
        Object.assign(about, { write: true, size: data.length, digest: hexOf(digest) });
      }
      let state = (await this.connection.ask(`rw/foe/${slave}`, {}, about)) as unknown as Transfer;
      this.#number = state.transfer;
      if (this.#cancelled) await this.cancel();
      while (data !== null && state.step === "receiving") {
        this.#show("receiving", state.received);
        const part = data.subarray(state.received, state.received + PART);
        state = await this.#insist(`rw/foe/${this.#number}/put`, { offset: state.received, data: hexOf(part) });
      }
      let [wait, longest]: [number, number] = [...PAUSES_MS];
      for (;;) {
        if (state.failure !== null) throw new AskError(state.failure);
        if (state.step === "done") break;
        this.#show(state.step, state.moved, state.busy);
        await pause(wait);
        wait = Math.min(2 * wait, longest);
        state = await this.#insist(`ro/foe/${this.#number}`);
      }
      if (data === null) this.content.value = await this.#fetch(state.moved);
      this.note.value = state.note;
      this.moved.value = state.moved;
    } catch (error) {
      this.error.value = error;
    }
    this.progress.value = null;
  }

  async #fetch(size: number): Promise<Uint8Array> {
    const all = new Uint8Array(size);
    let at = 0;
    while (at < size) {
      this.#show("fetching", at, "", size);
      const answer = await this.#insist<{ data: string }>(`ro/foe/${this.#number}/${at}`);
      const part = bytesOf(answer.data);
      if (part.length === 0) break;
      all.set(part, at);
      at += part.length;
    }
    return all.subarray(0, at);
  }

  /** Asks again while the way to the daemon is lost: the daemon knows the transfer by its number. */
  async #insist<T = Transfer>(key: string, payload: Value = {}): Promise<T> {
    for (let left = MOST_LOST; ; left -= 1) {
      try {
        return (await this.connection.ask(key, {}, payload)) as unknown as T;
      } catch (error) {
        const isLost = error instanceof AskError && ["unreachable", "timeout"].includes(error.failure.name);
        if (!isLost || left === 0) throw error;
        await pause(LOST_PAUSE_MS);
      }
    }
  }

  #show(step: Progress["step"], moved: number, busy = "", size = this.data?.length ?? null): void {
    this.progress.value = { step, moved, size, busy, seconds: (performance.now() - this.#begun) / 1000 };
  }
}
