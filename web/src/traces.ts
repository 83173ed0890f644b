// Which signals the page wants in each cycle: the parts of the page share one trace.
import type { Connection } from "./connection";
import type { Value } from "./protocol";

/** What a part of the page may ask of the connection. */
export interface Tracer {
  ask: Connection["ask"];
  setTrace(signals: string[]): number;
}

export class Traces {
  readonly #wishes = new Map<{ history: boolean }, string[]>();
  #asked = "";
  #generation = 0;

  constructor(private readonly connection: Connection) {}

  /**
   * For a part of the page; if `history`, its signals begin with their last seconds. Its batches also
   * have the signals of the other parts.
   */
  part(history = false): Tracer {
    const self = { history };
    return {
      ask: (key: string, parameters: Value = {}, payload: Value = {}) =>
        this.connection.ask(key, parameters, payload),
      setTrace: (signals: string[]) => {
        this.#wishes.set(self, signals);
        return this.#send();
      },
    };
  }

  #send(): number {
    const wishes = [...this.#wishes];
    const signals = union(wishes.map(([, names]) => names));
    const history = union(wishes.filter(([part]) => part.history).map(([, names]) => names));
    const text = JSON.stringify([signals, history]);
    if (text !== this.#asked) {
      this.#asked = text;
      this.#generation = this.connection.setTrace(signals, history);
    }
    return this.#generation;
  }
}

function union(lists: string[][]): string[] {
  return [...new Set(lists.flat())].sort();
}
