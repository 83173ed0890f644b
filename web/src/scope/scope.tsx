// The scope: signals over time, while they are recorded.
import type { BusEvent, Message, Signal } from "../protocol";
import type { Tracer } from "../traces";

/** What the rest of the page gives to the scope, and may ask of it. */
export class ScopeModel {
  constructor(private readonly connection: Tracer) {}

  /** All signals of the bus. */
  setSignals(_signals: Signal[]): void {}

  /** Draws a signal, which somebody has chosen elsewhere in the page. */
  add(_name: string): void {
    this.connection.setTrace([]);
  }

  takeBatch(_data: ArrayBuffer): void {}

  /** Events, for the track below the curves. */
  takeEvents(_events: BusEvent[]): void {}

  /** The way to the daemon, and the end of a file. */
  takeMessage(_message: Message): void {}
}

export function Scope(_props: { model: ScopeModel }) {
  return <section aria-label="Scope" />;
}
