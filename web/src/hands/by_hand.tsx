// Outputs by hand: the page holds free outputs at values, and renews them while it is seen.
import { useEffect, useMemo, useState } from "preact/hooks";

import { Section } from "../controls";
import type { Output } from "../maps";
import type { Signal } from "../protocol";
import type { State } from "../state";
import { Hand, type HandValue } from "./hand";

export function ByHand({ state }: { state: State }) {
  const hand = useMemo(() => new Hand(state.connection), []);
  const [chosen, setChosen] = useState<ReadonlyMap<string, HandValue>>(new Map());
  const [trouble, setTrouble] = useState("");
  useEffect(() => () => hand.release(), []);

  const outputs = state.of("ro/outputs").value.value?.outputs ?? [];
  const names = state.byName.value;
  const isFree = (output: Output) => output.owner < 0 && output.source === null;
  const free = outputs.filter((output) => isFree(output) && !chosen.has(output.name) && names.has(output.name));
  const holds = hand.holds.value;

  const change = (next: ReadonlyMap<string, HandValue>) => {
    setChosen(next);
    if (!hand.isHolding) return;
    if (next.size === 0) hand.release();
    else hand.hold(next);
  };
  const set = (name: string, value: HandValue) => change(new Map(chosen).set(name, value));
  const drop = (name: string) => change(new Map([...chosen].filter(([other]) => other !== name)));
  const add = (name: string) => {
    const output = outputs.find((item) => item.name === name);
    if (output !== undefined) set(name, output.value ?? 0);
  };
  const releaseAll = () => {
    hand.release();
    state.connection.ask("rw/outputs/release/all").then(
      () => setTrouble(""),
      (error: unknown) => setTrouble(error instanceof Error ? error.message : String(error)),
    );
  };
  return (
    <Section title="By hand" aside={holds ? "holding" : "not holding"}>
      <p class="muted">
        The page holds only outputs that nobody owns. They become safe as soon as you let go, hide the page, or lose the connection.
      </p>
      <ul class="values by-hand">
        {[...chosen].map(([name, value]) => {
          const signal = names.get(name);
          return signal === undefined ? null : (
            <li key={name}>
              <span class="value-name" title={name}>{signal.label}</span>
              <Control signal={signal} value={value} set={(next) => set(name, next)} />
              <button type="button" class="link" aria-label={`Take ${signal.label} off the list`} onClick={() => drop(name)}>×</button>
            </li>
          );
        })}
      </ul>
      <p class="actions">
        <select aria-label="Add an output" value="" onChange={(event) => { add(event.currentTarget.value); event.currentTarget.value = ""; }}>
          <option value="">Add an output…</option>
          {free.map((output) => <option key={output.name} value={output.name}>{output.slave} {names.get(output.name)!.label}</option>)}
        </select>
        {holds
          ? <button type="button" class="do" onClick={() => hand.release()}>Let go</button>
          : <button type="button" class="do" disabled={chosen.size === 0 || !state.fresh.value} onClick={() => hand.hold(chosen)}>Hold</button>}
        <button type="button" onClick={releaseAll} title="Outputs that anybody holds by hand, on any page">Release all by hand</button>
      </p>
      {(hand.trouble.value || trouble) !== "" && <p class="trouble" role="alert">{hand.trouble.value || trouble}</p>}
    </Section>
  );
}

function Control({ signal, value, set }: { signal: Signal; value: HandValue; set(value: HandValue): void }) {
  const named = Object.entries(signal.values);
  if (named.length > 0) {
    return (
      <select aria-label={signal.label} value={String(value)} onChange={(event) => set(Number(event.currentTarget.value))}>
        {!(String(value) in signal.values) && <option value={String(value)}>{String(value)}</option>}
        {named.map(([number, name]) => <option key={number} value={number}>{name}</option>)}
      </select>
    );
  }
  if (signal.bits === 1) {
    return (
      <button type="button" role="switch" class="switch" aria-checked={value === 1} aria-label={signal.label} onClick={() => set(value === 1 ? 0 : 1)}>
        {value === 1 ? "on" : "off"}
      </button>
    );
  }
  const physical = typeof value === "number" ? value * signal.scale + signal.offset : parseFloat(value);
  const take = (text: string) => {
    const number = Number(text);
    if (text !== "" && Number.isFinite(number)) set(signal.unit === "" ? text : `${text} ${signal.unit}`);
  };
  const limits = { min: signal.minimum ?? undefined, max: signal.maximum ?? undefined };
  return (
    <span class="value-number">
      {signal.minimum !== null && signal.maximum !== null && (
        <input type="range" aria-label={signal.label} min={signal.minimum} max={signal.maximum} step="any" value={physical} onInput={(event) => take(event.currentTarget.value)} />
      )}
      <input type="number" aria-label={`${signal.label}, ${signal.unit || "value"}`} step="any" {...limits} value={physical} onChange={(event) => take(event.currentTarget.value)} /> {signal.unit}
    </span>
  );
}
