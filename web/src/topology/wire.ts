// How the bus is wired: which slave is plugged in at which port of which other one.
// The rule is that of `ecatctl graph`.
import type { Bus, Errors, Link, Verdict } from "../maps";

/** Ports in the order in which a frame leaves through them (ETG.1000.4). */
const PORT_ORDER = [0, 3, 1, 2];
const MASTER = -1;

export interface Plug {
  /** The slave before it, or -1 for the master. */
  before: number;
  /** The port of that slave; of the master: 0 or 1 for its first or second interface. */
  port: number;
}

export interface Row {
  slave: number;
  /** How many branches it is away from the line at the master. */
  depth: number;
  /** The place in the rows of the slave before it; -1 for the master, null if nobody knows. */
  before: number | null;
  port: number | null;
  verdict: Verdict;
  text: string;
  /** The link is not there now: this is where it was. */
  gone: boolean;
}

/** The link that closes a ring. */
export function atSecondInterface(link: Link): boolean {
  return link.before === MASTER && link.before_port === 1;
}

/** Where each slave is plugged in, as far as the answer says. */
export function plugs(errors: Errors | null): Map<number, Plug> {
  const found = new Map<number, Plug>();
  for (const { position, ports } of errors?.slaves ?? []) {
    for (const number of PORT_ORDER) {
      const port = ports.find((item) => item.port === number);
      if (port?.to == null) continue;
      const [other] = port.to;
      if (other === MASTER && number === 0) found.set(position, { before: MASTER, port: 0 });
      else if (other > position) found.set(other, { before: position, port: number });
    }
  }
  return found;
}

/** All slaves in rows, branches indented: the last slave behind another one goes on in its line. */
export function rows(bus: Bus, errors: Errors | null, remembered: Map<number, Plug>): Row[] {
  const now = plugs(errors);
  const verdicts = new Map<number, Link>();
  for (const link of errors?.links ?? []) if (!atSecondInterface(link)) verdicts.set(link.slave, link);
  const behind = new Map<number, number[]>();
  const roots: number[] = [];
  const plug = (slave: number): Plug | null => {
    const link = verdicts.get(slave);
    const known = link === undefined ? undefined : { before: link.before, port: link.before_port };
    return now.get(slave) ?? known ?? remembered.get(slave) ?? null;
  };
  for (const { position } of bus.slaves) {
    const at = plug(position);
    if (at === null || at.before === MASTER) roots.push(position);
    else behind.set(at.before, [...(behind.get(at.before) ?? []), position]);
  }
  const placed: Row[] = [];
  const places = new Map<number, number>([[MASTER, MASTER]]);
  const waiting: [number, number][] = roots.reverse().map((slave) => [0, slave]);
  while (waiting.length > 0) {
    const [depth, slave] = waiting.pop()!;
    const at = plug(slave);
    const link = verdicts.get(slave);
    places.set(slave, placed.length);
    placed.push({
      slave, depth,
      before: at === null ? null : (places.get(at.before) ?? null),
      port: at === null || at.before === MASTER ? null : at.port,
      verdict: link?.verdict ?? "unknown",
      text: link?.text ?? "",
      // While a ring is open, the answer does not say where slaves are plugged in.
      gone: now.size > 0 && at !== null && !now.has(slave),
    });
    const children = (behind.get(slave) ?? []).sort((a, b) => a - b);
    const last = children.pop();
    if (last !== undefined) waiting.push([depth, last]);
    for (const child of children.reverse()) waiting.push([depth + 1, child]);
  }
  return placed;
}
