// Which signals the page wants in each cycle: the parts of the page share one trace.
import type { Connection } from "./connection";
import type { Value } from "./protocol";

/** What a part of the page may ask of the connection. */
export type Tracer = Pick<Connection, "ask" | "setTrace">;

export class Traces {
  private readonly wishes = new Map<object, string[]>();
  private asked = "";
  private generation = 0;

  constructor(private readonly connection: Connection) {}

  /** For a part of the page. Its batches also have the signals of the other parts. */
  part(): Tracer {
    const self = {};
    return {
      ask: (key: string, parameters: Value = {}, payload: Value = {}) =>
        this.connection.ask(key, parameters, payload),
      setTrace: (signals: string[]) => {
        this.wishes.set(self, signals);
        return this.send();
      },
    };
  }

  private send(): number {
    const union = [...new Set([...this.wishes.values()].flat())].sort();
    const text = union.join("\n");
    if (text !== this.asked) {
      this.asked = text;
      this.generation = this.connection.setTrace(union);
    }
    return this.generation;
  }
}
