// The maps of docs/zenoh-keys.md that the page reads, as far as it reads them.
import type { Failure } from "./protocol";

export interface Slave {
  position: number;
  name: string;
  given_name: string;
  vendor: number;
  product: number;
  revision: number;
  serial: number;
  alias: number;
  address: number;
  identification: number;
  coe: boolean;
  eoe: boolean;
  soe: boolean;
  foe: boolean;
  group: string;
  problems: string[];
  profiles: { description: string }[];
  modules: { ident: number; name: string }[];
  domain: number;
  dc_bits: number;
  dc_delay_ns: number;
  sync0_ns: number;
  sync1_ns: number;
  watchdog_ms: number | null;
}

export interface Bus {
  fingerprint: string;
  name: string;
  cycle_time_us: number;
  slaves: Slave[];
}

export interface Info {
  version: string;
  host: string;
  interface: string;
  cycle_time_us: number;
  links: Record<string, string>;
  recovery: { slave: number; state: string; text: string }[];
}

export interface AlState {
  position: number;
  al_state: number;
  al_code: number;
  text: string;
  recovery: string;
  recovery_text: string;
  since: number | null;
  revision: number;
  serial: number;
}

export interface Fault {
  kind: string;
  text: string;
  since: number;
  slaves: number[];
}

export interface States {
  slaves: AlState[];
  missing: { expected: number[]; text: string }[];
  others: string;
  faults: Fault[];
}

/** Buckets: lower bound, upper bound (exclusive) and count, in µs. */
export type Bucket = [number, number, number];

export interface Distribution {
  count: number;
  mean?: number;
  min?: number;
  p50?: number;
  p99?: number;
  p999?: number;
  max?: number;
  buckets?: Bucket[];
}

export interface Setting {
  setting: string;
  wanted: boolean;
  granted: boolean;
  value: number;
  reason: string;
}

export interface Statistics {
  state: string;
  instance: number;
  cycle_time_us: number;
  seconds: number;
  cycles: number;
  missed: number;
  frames: number;
  lost: number;
  late: number;
  wkc_bad: number;
  lapses: number;
  links: string[];
  ring: { state: string; break: number };
  dc: { state: string; reference: number; drift_ppb: number };
  realtime: {
    scheduling: string;
    priority: number;
    cpu: number;
    memory_locked: boolean;
    settings: Setting[];
  };
  wakeup: Distribution;
  exchange: Distribution;
  cycle: Distribution;
  delay: Distribution;
  dc_offset: Distribution;
}

export interface PortErrors {
  port: number;
  invalid: number;
  physical: number;
  forwarded: number;
  lost_links: number;
  to: [number, number] | null;
}

export type Verdict = "good" | "strained" | "bad" | "unknown";

/** A link of the bus, and what its counters say about the cable. */
export interface Link {
  slave: number;
  port: number;
  before: number;
  before_port: number;
  verdict: Verdict;
  text: string;
}

export interface Errors {
  slaves: {
    position: number;
    ports: PortErrors[];
    processing: number;
    pdi: number;
    since: number | null;
  }[];
  links?: Link[];
}

export interface Owner {
  name: string | null;
  pid: number | null;
  by_hand: boolean;
  user: string;
  state?: string;
  since?: number | null;
  lease_ms?: number | null;
  silent_ms?: number | null;
  process?: string | null;
}

export interface Output {
  name: string;
  slave: number;
  address: string;
  state: string;
  owner: number;
  cause: string;
  reason: string;
  source: string | null;
  since: number | null;
  value: number | null;
}

export interface Outputs {
  owners: Owner[];
  outputs: Output[];
  problems?: string[];
}

export interface ObjectEntry {
  subindex: number;
  name: string;
  data_type: number;
  bit_length: number;
  access: number;
}

export interface ObjectDescription {
  index: number;
  name: string;
  code: number;
  data_type: number;
  entries: ObjectEntry[];
}

export interface Sdo {
  data: string;
  name: string;
  data_type: number;
  unit?: string;
  scale?: number;
  offset?: number;
}

export interface Configuration {
  config: Record<string, unknown>;
  origins: Record<string, string>;
}

/** What has happened in an incident, in words. */
export interface Reading {
  text: string;
}

/** A transfer of a file. */
export interface Transfer {
  transfer: number;
  step: "receiving" | "to boot" | "transferring" | "from boot" | "done" | "failed";
  received: number;
  moved: number;
  busy: string;
  failure: Failure | null;
  note: string;
}

/** The worst cycles since the start, and of the last 300 and 60 s. */
export type Worst = Record<"start" | "300" | "60", {
  name: string;
  title: string;
  cycle: number;
  took_us: number;
  /** Unix time in seconds. */
  at: number;
  /** What stood beside it, as sentences. */
  beside: string[];
}[]>;
