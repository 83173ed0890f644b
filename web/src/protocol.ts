// What the page and `ecatctl web` say to each other over the WebSocket `/socket`.
// daemon/ecatd/web/ is the other side.

/** A map as docs/zenoh-keys.md describes it. Bytes are hex strings. */
export type Value = Record<string, unknown>;

export interface Failure {
  /** One of those in docs/troubleshooting.md. */
  name: string;
  /** What is wrong, where, and what to do. */
  message: string;
}

/** A signal of the bus: one PDO entry. Physical value = raw value * scale + offset. */
export interface Signal {
  /** SLAVE/ADDRESS, such as `4/0x6041:00`: its identity in all messages. */
  name: string;
  /** For people: names of the slave and of the entry. */
  label: string;
  /** SLAVE/ENTRY, as `ecatctl record` calls it. */
  path: string;
  slave: number;
  address: string;
  output: boolean;
  type: ColumnType;
  bits: number;
  scale: number;
  offset: number;
  unit: string;
  /** Limits of an output, physical; null: as the type allows. */
  minimum: number | null;
  maximum: number | null;
  /** Names of raw values. */
  values: Record<string, string>;
}

export type LampState = "good" | "warning" | "bad" | "unknown";

export interface Lamp {
  id: string;
  title: string;
  state: LampState;
  /** One sentence. */
  text: string;
  /** Unix time in seconds since which it is in this state; null if nobody knows. */
  since: number | null;
  evidence: { panel: "topology" | "timing" | "outputs" | "events"; slave: number | null };
}

/** A map of docs/zenoh-keys.md; the keys of its kind are there, too. */
export interface BusEvent extends Value {
  event: string;
  severity: "error" | "warning" | "notice" | "info";
  sequence: number;
  time_ns: number;
  text: string;
}

export interface Rights {
  /** Rights that the page may use; none: it only reads. */
  may: string[];
  /** Who is logged in; empty without logins. */
  user: string;
  /** Names of the buses that `?bus=NAME` in the address of the page can choose, if there are several. */
  buses: string[];
}

/** Server → page. */
export type Message =
  /** The first message. */
  | ({ type: "hello"; version: string; source: "bus" | "file"; title: string } & Rights)
  /** They have changed. */
  | ({ type: "rights" } & Rights)
  /** The way to the daemon. While it is down, all values are old. */
  | { type: "link"; up: boolean; text: string; since: number }
  /** Those that a file is about are `shown` at first. */
  | { type: "signals"; signals: Signal[]; shown: string[] }
  /**
   * What the server watches: the answer to the query `key`, or why there is none. `key` "reading":
   * what has happened in an incident, as `text`; "worst": the worst cycles.
   */
  | { type: "value"; key: string; value: Value | null; failure?: Failure; at: number }
  | { type: "lamps"; lamps: Lamp[]; at: number }
  | { type: "events"; events: BusEvent[]; left_out: number }
  | { type: "answer"; ask: number; answer: Value }
  | { type: "failure"; ask: number; failure: Failure }
  /** All of a file was sent. */
  | { type: "end" }
  /** The server is there, and has had nothing else to say for a second. */
  | { type: "beat" };

/** Page → server. */
export type Request =
  /** A query of docs/zenoh-keys.md. The server adds `id` and `by`. */
  | { type: "ask"; ask: number; key: string; parameters: Value; payload: Value }
  /**
   * The signals whose value in each cycle the page wants from now on; none ends it. Those of them in
   * `history` begin with their last seconds.
   */
  | { type: "trace"; signals: string[]; history: string[]; generation: number };

export type ColumnType =
  | "int8" | "uint8" | "int16" | "uint16" | "int32" | "uint32" | "int64" | "uint64"
  | "float32" | "float64";

export type Column =
  | Int8Array | Uint8Array | Int16Array | Uint16Array | Int32Array | Uint32Array
  | BigInt64Array | BigUint64Array | Float32Array | Float64Array;

interface BatchHeader {
  /** `generation` of the request that it answers. */
  generation: number;
  /**
   * "minmax": the page was too slow for all cycles; each place stands for several of them.
   * "history": the cycles are from before those that have come, and have only new signals.
   */
  kind: "raw" | "minmax" | "history";
  count: number;
  cycles: number;
  last_cycles?: number;
  times: number;
  columns: { name: string; type: ColumnType; at?: number; min?: number; max?: number }[];
  invalid: number[][];
  lost: boolean;
}

/** Some cycles of a trace. */
export interface Batch {
  generation: number;
  kind: BatchHeader["kind"];
  /** Numbers of the cycles; a number that is missing was not exchanged. */
  cycles: Float64Array;
  /** For "minmax": the last cycle of each place. */
  lastCycles: Float64Array | null;
  /** Unix time in ms. */
  times: Float64Array;
  /** By name of the signal: raw values, or for "minmax" the least and the greatest one. */
  columns: Map<string, { values: Column } | { min: Float64Array; max: Float64Array }>;
  /** By name of the signal: places at which it has an older value, as its slave took no part. */
  invalid: Map<string, number[]>;
  /** Whether cycles before the batch were lost on the way. */
  lost: boolean;
}

const ARRAYS = {
  int8: Int8Array, uint8: Uint8Array, int16: Int16Array, uint16: Uint16Array,
  int32: Int32Array, uint32: Uint32Array, int64: BigInt64Array, uint64: BigUint64Array,
  float32: Float32Array, float64: Float64Array,
} as const;

/** Reads a binary message. Its arrays are views of `data`, little endian as all browsers are. */
export function readBatch(data: ArrayBuffer): Batch {
  const length = new DataView(data).getUint32(0, true);
  const text = new TextDecoder().decode(new Uint8Array(data, 4, length));
  const header = JSON.parse(text) as BatchHeader;
  const { count } = header;
  const doubles = (at: number) => new Float64Array(data, at, count);
  const columns: Batch["columns"] = new Map();
  for (const { name, type, at, min, max } of header.columns) {
    columns.set(
      name,
      at === undefined
        ? { min: doubles(min!), max: doubles(max!) }
        : { values: new ARRAYS[type](data, at, count) },
    );
  }
  return {
    generation: header.generation,
    kind: header.kind,
    cycles: doubles(header.cycles),
    lastCycles: header.last_cycles === undefined ? null : doubles(header.last_cycles),
    times: doubles(header.times),
    columns,
    invalid: new Map(
      header.invalid.map(([column, ...places]) => [header.columns[column!]!.name, places]),
    ),
    lost: header.lost,
  };
}
