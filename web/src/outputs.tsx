// Who drives what: owners of outputs, and why the other outputs are safe.
import { useState } from "preact/hooks";

import { Section } from "./controls";
import { ByHand } from "./hands/by_hand";
import type { Output, Owner } from "./maps";
import type { State } from "./state";
import { counted, lasting, shortName, shown } from "./text";

const STATES: Record<string, string> = { claimed: "not written yet", stopping: "stopping the drive" };

function ownerName(owner: Owner): string {
  const name = owner.by_hand ? `${owner.user || "somebody"}, by hand` : (owner.name ?? "a program without a name");
  return owner.pid === null || owner.by_hand ? name : `${name} (${owner.pid})`;
}

export function OutputsPanel({ state }: { state: State }) {
  const [search, setSearch] = useState("");
  const { value, failure } = state.of("ro/outputs").value;
  if (value === null) {
    return <p class="empty">{failure === null ? "No answer yet." : failure.message}</p>;
  }
  const names = state.byName.value;
  const now = state.now.value;
  const label = (output: Output) => names.get(output.name)?.label ?? output.name;
  const wanted = search.toLowerCase();
  const found = value.outputs.filter((item) => `${item.name} ${label(item)}`.toLowerCase().includes(wanted));
  const groups = new Map<number, Output[]>();
  for (const output of found) groups.set(output.slave, [...(groups.get(output.slave) ?? []), output]);
  const owned = (at: number) => value.outputs.filter((item) => item.owner === at).length;
  const free = value.outputs.filter((item) => item.owner < 0 && item.source === null).length;
  return (
    <div class="outputs">
      {state.may("outputs") && <ByHand state={state} />}
      <Section title="Owners" aside={`${counted(free, "output")} of ${value.outputs.length} without owner`}>
        {(value.problems ?? []).map((text) => <p class="trouble" key={text}>{text}</p>)}
        {value.owners.length === 0 ? <p class="empty">No program owns outputs: all have their safe values.</p> : (
          <table>
            <thead><tr><th>Program</th><th class="number">Outputs</th><th class="number">Silent</th><th class="number">Lease</th></tr></thead>
            <tbody>
              {value.owners.map((owner, at) => {
                const silent = owner.silent_ms ?? null;
                const late = silent !== null && owner.lease_ms != null && owner.lease_ms > 0 && silent > owner.lease_ms / 2;
                return (
                  <tr key={at}>
                    <td>{ownerName(owner)}{owner.state === "lapsed" && <span class="tag warning" title="The program is there, but hangs or was stopped: its lease has ended.">silent{owner.process && ` · ${owner.process}`}</span>}</td>
                    <td class="number">{owned(at)}</td>
                    <td class={`number ${late ? "text-warn" : ""}`}>{silent === null ? "–" : silent < 10000 ? `${Math.round(silent)} ms` : lasting(silent / 1000)}</td>
                    <td class="number">{owner.lease_ms == null || owner.lease_ms === 0 ? "–" : `${owner.lease_ms} ms`}</td>
                  </tr>
                );
              })}
            </tbody>
          </table>
        )}
      </Section>
      <div class="toolbar"><input type="search" placeholder="Search outputs" aria-label="Search outputs" value={search} onInput={(e) => setSearch(e.currentTarget.value)} /></div>
      {[...groups].map(([slave, outputs]) => (
        <Section key={slave} title={`${slave} ${state.slaveName(slave)}`} aside={<button type="button" class="link" aria-label={`Open slave ${slave}`} onClick={() => state.open(slave)}>open</button>}>
          <ul class="values">
            {outputs.map((output) => {
              const signal = names.get(output.name);
              const owner = value.owners[output.owner];
              const who = owner !== undefined ? ownerName(owner) : output.source !== null ? `copied from ${output.source}` : output.state === "can" ? "CAN frames" : "safe";
              const since = output.since === null ? "" : lasting(now - output.since);
              return (
                <li key={output.name}>
                  <span class="value-name" title={output.name}>{signal === undefined ? output.address : shortName(signal)}</span>
                  <span class="value-number">{output.value === null ? "–" : signal === undefined ? output.value : shown(signal, output.value)}</span>
                  <span class={`value-note ${output.state}`}>
                    {who}{since !== "" && ` · ${since}`}{STATES[output.state] !== undefined && ` · ${STATES[output.state]!}`}
                    {output.owner < 0 && output.reason !== "" && <span> · {output.reason}</span>}
                  </span>
                </li>
              );
            })}
          </ul>
        </Section>
      ))}
    </div>
  );
}
