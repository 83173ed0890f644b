// Does the cycle keep its time: histograms against the cycle, and the settings of real time.
import { useState } from "preact/hooks";

import { Facts, Section, Tabs } from "./controls";
import { columns, difference, type Marks, marks, marksOf } from "./histogram";
import type { Bucket, Statistics } from "./maps";
import type { State } from "./state";
import { clock, counted, grouped, lasting, microseconds } from "./text";

const SHOWN = [
  ["exchange", "Exchange", "from the first frame sent to the last one received"],
  ["wakeup", "Wake-up", "from the deadline of a cycle to its start"],
  ["cycle", "Cycle", "from the start of a cycle to its end"],
  ["dc_offset", "Clock", "phase of the cycle to the reference clock"],
] as const;
const WINDOWS = [["start", "Since the start"], ["300", "5 min"], ["60", "1 min"]] as const;
type Window = (typeof WINDOWS)[number][0];
const PLACES = 72;

export function Timing({ state }: { state: State }) {
  const [window, setWindow] = useState<Window>("start");
  const { failure } = state.of("ro/stats").value;
  const readings = state.readings.value;
  const last = readings.at(-1);
  if (last === undefined) return <p class="empty">{failure === null ? "No answer yet." : failure.message}</p>;
  const { statistics } = last;
  const before = window === "start" ? null : (readings.find((item) => item.at >= last.at - Number(window)) ?? null);
  const over = before === null ? statistics.seconds : last.at - before.at;
  const since = (name: "missed" | "lost" | "late" | "wkc_bad" | "cycles") =>
    statistics[name] - (before?.statistics[name] ?? 0);
  return (
    <div class="timing">
      {failure !== null && <p class="trouble" role="alert">{failure.message}</p>}
      <Tabs label="Time span" small tabs={WINDOWS} chosen={window} choose={(chosen) => setWindow(chosen)} />
      <p class="muted pad">
        {counted(since("cycles"), "cycle")} of {microseconds(statistics.cycle_time_us)} in {lasting(Math.max(1, over))}
        {before !== null && over < Number(window) - 3 && " (since this page was opened)"}
      </p>
      <div class="counts">
        {([["missed", "cycles missed"], ["lost", "frames lost"], ["late", "frames late"], ["wkc_bad", "wrong working counters"]] as const).map(
          ([name, title]) => (
            <div key={name} class={since(name) > 0 ? "count-box some" : "count-box"}>
              <strong>{grouped(since(name))}</strong><span>{title}</span>
            </div>
          ),
        )}
      </div>
      <WorstCycles state={state} window={window} />
      {SHOWN.map(([name, title, meaning]) => {
        const all = statistics[name];
        const buckets = before === null ? (all.buckets ?? []) : difference(all.buckets ?? [], before.statistics[name].buckets ?? []);
        return (
          <Histogram
            key={name} title={title} meaning={meaning} cycle={statistics.cycle_time_us}
            buckets={buckets} found={before === null ? marks(all) : marksOf(buckets)}
          />
        );
      })}
      <RealTime statistics={statistics} />
    </div>
  );
}

function Histogram(props: { title: string; meaning: string; cycle: number; buckets: Bucket[]; found: Marks }) {
  const { title, meaning, cycle, buckets, found } = props;
  if (found.count === 0) {
    return <Section title={title}><p class="empty">Nothing measured: {meaning}.</p></Section>;
  }
  const low = 10 ** Math.floor(Math.log10(Math.max(0.01, buckets[0]?.[0] ?? 1)));
  const high = 10 ** Math.ceil(Math.log10(Math.max(cycle * 1.5, buckets.at(-1)?.[1] ?? 1)));
  const counts = columns(buckets, low, high, PLACES);
  const most = Math.max(...counts, 1);
  const width = 360, height = 64, foot = 16;
  const x = (value: number) => (Math.log(Math.max(value, low) / low) / Math.log(high / low)) * width;
  // Rare cycles are those that matter: the height is logarithmic, too.
  const tall = (count: number) => (count <= 0 ? 0 : Math.max(1.5, (Math.log1p(count) / Math.log1p(most)) * (height - 4)));
  const decades: number[] = [];
  for (let value = low; value <= high * 1.001; value *= 10) decades.push(value);
  const late = (found.max ?? 0) > cycle && title !== "Clock";
  const said = `${title}: half within ${microseconds(found.p50)}, 99 % within ${microseconds(found.p99)}, 99.9 % within ${microseconds(found.p999)}, at most ${microseconds(found.max)}`;
  return (
    <Section title={title} aside={meaning}>
      <svg class="histogram" viewBox={`0 0 ${width} ${height + foot}`} role="img" aria-label={said}>
        {x(cycle) < width && <rect class="beyond" x={x(cycle)} y="0" width={width - x(cycle)} height={height} />}
        {decades.map((value) => (
          <g key={value}>
            <line class="grid" x1={x(value)} x2={x(value)} y1="0" y2={height} />
            <text x={Math.min(width - 2, Math.max(2, x(value)))} y={height + 12} text-anchor={value === low ? "start" : value >= high * 0.99 ? "end" : "middle"}>{microseconds(value)}</text>
          </g>
        ))}
        {counts.map((count, at) => count > 0 && (
          <rect key={at} class={low * (high / low) ** (at / PLACES) >= cycle && title !== "Clock" ? "bar late" : "bar"} x={(at * width) / PLACES} width={width / PLACES - 0.75} y={height - tall(count)} height={tall(count)} />
        ))}
        <line class="base" x1="0" x2={width} y1={height} y2={height} />
        {([found.p99, found.p999, found.max] as const).map((value, at) => value !== undefined && (
          <line key={at} class={at === 2 ? "edge" : "edge soft"} x1={x(value)} x2={x(value)} y1={at === 2 ? 0 : 8} y2={height} />
        ))}
      </svg>
      <dl class="marks">
        <div><dt>half</dt><dd>{microseconds(found.p50)}</dd></div>
        <div><dt>99 %</dt><dd>{microseconds(found.p99)}</dd></div>
        <div><dt>99.9 %</dt><dd>{microseconds(found.p999)}</dd></div>
        <div class={late ? "text-warn" : ""}><dt>longest</dt><dd>{microseconds(found.max)}</dd></div>
      </dl>
    </Section>
  );
}

/** When it was worst, and what happened then. */
function WorstCycles({ state, window }: { state: State; window: Window }) {
  const found = state.of("worst").value.value?.[window] ?? [];
  if (found.length === 0) return null;
  return (
    <Section title="Worst cycles" aside="and what stood beside them">
      <ul class="event-list">
        {found.map(({ name, title, took_us, cycle, at, beside }) => (
          <li key={name} class="worst">
            <strong>{title} {microseconds(took_us)}</strong>
            <div class="event-when"><time>{clock(at, true)}</time><span>{state.ago(at)}</span><span>cycle {grouped(cycle)}</span></div>
            {beside.length === 0 ? <p>Nothing else is known of it: <code>ecatctl doctor</code> looks for what keeps this computer busy.</p>
              : beside.length === 1 ? <p>{beside[0]}</p> : <ul>{beside.map((text) => <li key={text}>{text}</li>)}</ul>}
          </li>
        ))}
      </ul>
    </Section>
  );
}

function RealTime({ statistics }: { statistics: Statistics }) {
  const { realtime, dc } = statistics;
  const refused = realtime.settings.filter((item) => item.wanted && !item.granted);
  return (
    <Section title="Real time">
      <Facts
        rows={[
          ["Scheduling", realtime.scheduling === "SCHED_FIFO" ? `real-time, priority ${realtime.priority}` : "like any program: other work delays the cycle"],
          ["Processor", realtime.cpu < 0 ? "any" : `number ${realtime.cpu} only`],
          ["Memory", realtime.memory_locked ? "locked" : "not locked: a page fault may delay a cycle"],
          ["Clocks", dc.state === "off" ? "not used" : `${dc.state}, reference is slave ${dc.reference}, drift ${grouped(dc.drift_ppb)} ppb`],
        ]}
      />
      {refused.map((item) => (
        <p class="note warning" key={item.setting}>The system refused {item.setting}{item.reason !== "" && `: ${item.reason}`}. `ecatctl doctor` says what to do.</p>
      ))}
    </Section>
  );
}
