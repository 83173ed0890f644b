// The bus as it is wired.
import { useEffect, useMemo, useRef, useState } from "preact/hooks";

import { showPanel } from "../controls";
import type { AlState, Slave } from "../maps";
import type { State } from "../state";
import { microseconds } from "../text";
import { atSecondInterface, type Plug, plugs, type Row, rows } from "./wire";

const STATES: Record<number, string> = { 0: "no answer", 1: "INIT", 2: "PREOP", 3: "BOOT", 4: "SAFEOP", 8: "OP" };
const INDENT = 22;
const LEFT = 22;
const MANY = 40;
/** A frame enters through port 0 and goes on through port 1, if nothing branches off. */
const USUAL_PORT = 1;

export function stateText(al: number): string {
  return (STATES[al & 15] ?? `state ${al & 15}`) + (al & 16 ? " error" : "");
}

/** How a slave is, for its colour. */
export function health(state: AlState | undefined): "op" | "coming" | "wrong" | "away" | "unknown" {
  if (state === undefined) return "unknown";
  if (state.recovery === "absent") return "away";
  if (state.al_state === 8 && state.recovery === "") return "op";
  return state.recovery === "recovering" && !(state.al_state & 16) ? "coming" : "wrong";
}

/** How many values it exchanges. */
function amount(state: State, slave: Slave): string {
  const all = state.bySlave.value.get(slave.position) ?? [];
  const outputs = all.filter((item) => item.output).length;
  return [all.length > outputs ? `${all.length - outputs} in` : "", outputs > 0 ? `${outputs} out` : ""].filter(Boolean).join(", ");
}

/** A text that fits: SVG cuts nothing. */
function cut(text: string, width: number, each: number): string {
  const most = Math.max(3, Math.floor(width / each));
  return text.length <= most ? text : `${text.slice(0, most - 1)}…`;
}

export function Topology({ state }: { state: State }) {
  const bus = state.bus.value;
  const errors = state.of("ro/errors").value.value;
  const statistics = state.of("ro/stats").value.value;
  const info = state.of("ro/info").value.value;
  const [search, setSearch] = useState("");
  const [dense, setDense] = useState<boolean | null>(null);
  const [width, setWidth] = useState(280);
  const box = useRef<HTMLDivElement>(null);
  const remembered = useRef<{ bus: string; plugs: Map<number, Plug> }>({ bus: "", plugs: new Map() });
  useEffect(() => {
    const watch = new ResizeObserver(([entry]) => setWidth(Math.floor(entry!.contentRect.width)));
    watch.observe(box.current!);
    return () => watch.disconnect();
  }, []);
  const placed = useMemo<Row[]>(() => {
    if (bus === null) return [];
    if (remembered.current.bus !== bus.fingerprint) remembered.current = { bus: bus.fingerprint, plugs: new Map() };
    for (const [slave, plug] of plugs(errors)) remembered.current.plugs.set(slave, plug);
    return rows(bus, errors, remembered.current.plugs);
  }, [bus, errors]);
  const faulty = new Set((state.states.value?.faults ?? []).filter((fault) => fault.kind === "drive").flatMap((fault) => fault.slaves));
  const states = new Map((state.states.value?.slaves ?? []).map((item) => [item.position, item]));
  const small = dense ?? placed.length > MANY;
  const step = small ? 26 : 46;
  const tall = small ? 22 : 36;
  const top = tall + 14;
  const wanted = search.trim().toLowerCase();
  const hit = (slave: Slave) =>
    wanted !== "" && `${slave.position} ${slave.given_name} ${slave.name} ${slave.group}`.toLowerCase().includes(wanted);
  const hits = bus?.slaves.filter(hit) ?? [];
  const selected = state.selected.value;
  const current = placed.findIndex((row) => row.slave === selected);
  const ring = statistics?.ring.state ?? "none";
  const closing = errors?.links?.find(atSecondInterface)?.verdict ?? "unknown";
  /** Slaves before the place where the ring is open. */
  const broken = ring === "open" ? statistics!.ring.break : null;
  const right = ring === "none" ? 6 : 22;
  const measured = bus?.slaves.some((slave) => slave.dc_delay_ns > 0) ?? false;

  const nodeOf = (slave: number) => box.current?.querySelector<SVGGElement>(`[data-slave="${slave}"]`);
  useEffect(() => nodeOf(selected ?? 0)?.scrollIntoView({ block: "nearest" }), [selected, placed.length]);
  const show = (at: number) => {
    const row = placed[Math.max(0, Math.min(placed.length - 1, at))];
    if (row === undefined) return;
    state.selected.value = row.slave;
    requestAnimationFrame(() => nodeOf(row.slave)?.focus());
  };
  const onKey = (event: KeyboardEvent) => {
    const row = placed[Math.max(0, current)];
    const moves: Record<string, () => void> = {
      ArrowDown: () => show(current + 1),
      ArrowUp: () => show(current - 1),
      Home: () => show(0),
      End: () => show(placed.length - 1),
      // Along the wire: into the branch, and back to where it begins.
      ArrowRight: () => show(current + 1),
      ArrowLeft: () => row?.before != null && row.before >= 0 && show(row.before),
      Enter: () => {
        if (row === undefined) return;
        state.open(row.slave);
        showPanel();
      },
    };
    const move = moves[event.key];
    if (move === undefined) return;
    event.preventDefault();
    move();
  };
  const x = (row: { depth: number }) => LEFT + row.depth * INDENT;
  const y = (at: number) => top + at * step;
  const last = placed.length - 1;
  const height = y(last + 1) + (ring === "none" ? 0 : 8);
  return (
    <>
      <div class="toolbar">
        <input
          id="find-slave" type="search" placeholder="Find a slave" aria-label="Find a slave" value={search}
          onInput={(event) => {
            setSearch(event.currentTarget.value);
            const text = event.currentTarget.value.trim().toLowerCase();
            const first = text === "" ? -1 : placed.findIndex((row) => `${row.slave} ${state.slaveName(row.slave)} ${bus?.slaves[row.slave]?.name ?? ""}`.toLowerCase().includes(text));
            if (first >= 0) nodeOf(placed[first]!.slave)?.scrollIntoView({ block: "center" });
          }}
          onKeyDown={(event) => {
            if (event.key === "Escape") {
              event.preventDefault();
              showPanel("#topology [tabindex='0']");
            } else if (event.key === "Enter" && hits[0] !== undefined) {
              state.open(hits[0].position);
              showPanel();
            }
          }}
        />
        {wanted !== "" && <span class="muted found" role="status">{hits.length} found</span>}
        <button type="button" class="quiet" aria-pressed={small} onClick={() => setDense(!small)} title={small ? "Show more of each slave" : "Show more slaves"}>{small ? "+" : "−"}</button>
      </div>
      <div class="wire" ref={box}>
        {bus === null ? <p class="empty">{state.nothing()}</p> : (
          <svg width={width} height={height} role="tree" aria-label={`Slaves of ${bus.name}, as they are wired`} onKeyDown={onKey}>
            <g aria-hidden="true">
              <rect class="master" x={LEFT - 14} y="4" width={width - LEFT + 14 - right} height={tall} rx="3" />
              <text class="node-name" x={LEFT - 4} y={4 + (small ? 15 : 16)}>Master</text>
              <text class="node-note" x={small ? width - right - 8 : LEFT - 4} y={4 + (small ? 15 : 29)} text-anchor={small ? "end" : "start"}>
                {Object.entries(info?.links ?? {}).map(([name, link]) => `${name} ${link.replace("_", " ")}`).join(" · ") || bus.name}
              </text>
              {ring !== "none" && last >= 0 && (
                <g>
                  <path class={`cable ${closing} ${broken === last + 1 ? "gone" : ""}`} d={`M${width - right} ${4 + tall / 2} H${width - 7} V${y(last) + tall / 2} H${width - right}`} />
                  <text class="node-note" text-anchor="middle" transform={`translate(${width - 12} ${Math.min(y(2), y(last))}) rotate(-90)`}>
                    ring {ring}
                  </text>
                </g>
              )}
              {placed.map((row, at) => {
                if (row.before === null) return null;
                const parent = row.before < 0 ? { depth: 0 } : placed[row.before]!;
                const from = row.before < 0 ? 4 + tall : y(row.before) + tall;
                const kind = `cable ${row.verdict} ${row.gone || broken === row.slave ? "gone" : ""} ${health(states.get(row.slave))}`;
                const path = parent.depth === row.depth
                  ? `M${x(row)} ${from} V${y(at)}`
                  : `M${x(parent) + 4} ${from} V${y(at) + tall / 2} H${x(row) - 14}`;
                return <path key={row.slave} class={kind} d={path} />;
              })}
            </g>
            {placed.map((row, at) => {
              const slave = bus.slaves[row.slave]!;
              const al = states.get(row.slave);
              const isFaulty = faulty.has(row.slave) && al?.al_state === 8;
              const kind = isFaulty ? "wrong" : health(al);
              const name = slave.given_name || slave.name || "without a name";
              const left = x(row) - 14;
              const wide = width - left - right;
              const words = al === undefined ? "" : isFaulty ? "FAULT" : kind === "away" ? "absent" : stateText(al.al_state);
              const delay = measured && slave.dc_bits > 0 ? microseconds(slave.dc_delay_ns / 1000) : "";
              const notes = [slave.given_name !== "" ? slave.name : "", row.port !== null && row.port !== USUAL_PORT ? `at port ${row.port}` : "", amount(state, slave), slave.group !== "" ? `optional: ${slave.group}` : ""];
              const note = notes.filter((text) => text !== "").join(" · ");
              const classes = `node ${kind} ${row.slave === selected ? "selected" : ""} ${slave.group !== "" ? "optional" : ""} ${wanted !== "" && !hit(slave) ? "dim" : ""}`;
              return (
                <g
                  key={row.slave} class={classes} role="treeitem" data-slave={row.slave}
                  tabindex={row.slave === selected || (current < 0 && at === 0) ? 0 : -1}
                  aria-level={row.depth + 1} aria-selected={row.slave === selected}
                  onClick={() => state.open(row.slave)} transform={`translate(${left} ${y(at)})`}
                >
                  <title>{`${row.slave} ${name}, ${words}${note === "" ? "" : `, ${note}`}${row.text === "" ? "" : `, cable ${row.verdict}: ${row.text}`}`}</title>
                  <g aria-hidden="true">
                  <rect class="node-box" width={wide} height={tall} rx="3" />
                  {kind !== "op" && kind !== "unknown" && <rect class="node-bar" width="3" height={tall} rx="1" />}
                  <text class="node-number" x="28" y={small ? 15 : 16} text-anchor="end">{row.slave}</text>
                  <text class="node-name" x="36" y={small ? 15 : 16}>{cut(name, wide - 48 - words.length * 7, 7.5)}</text>
                  <text class="node-state" x={wide - 8} y={small ? 15 : 16} text-anchor="end">{words}</text>
                  {!small && <text class="node-note" x="36" y="29">{cut(note, wide - 50 - delay.length * 6, 6)}</text>}
                  {!small && <text class="node-note" x={wide - 8} y="29" text-anchor="end">{delay}</text>}
                  </g>
                </g>
              );
            })}
          </svg>
        )}
      </div>
    </>
  );
}
