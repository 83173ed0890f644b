// All about one slave.
import { Facts, Section, Tabs } from "../controls";
import type { AlState, Slave } from "../maps";
import type { Part, State } from "../state";
import { health, stateText } from "../topology/topology";
import { clock, hex, lasting, microseconds } from "../text";
import { Memory } from "./eeprom";
import { Files } from "./files";
import { Health } from "./health";
import { Objects } from "./objects";
import { ProcessData } from "./process_data";
import { SetUp } from "./set_up";

const PARTS: readonly (readonly [Part, string])[] = [
  ["now", "Now"], ["objects", "Objects"], ["setup", "Set-up"], ["health", "Health"], ["files", "Files"], ["memory", "EEPROM"],
];

export function SlavePanel({ state }: { state: State }) {
  const position = state.selected.value;
  const slave = position === null ? undefined : state.bus.value?.slaves[position];
  if (slave === undefined) {
    const { bus: { value: bus } } = state;
    return <p class="empty">{bus === null ? state.nothing() : bus.slaves.length === 0 ? "The bus has no slaves." : position === null ? "Choose a slave on the left." : `The bus has no slave ${position}.`}</p>;
  }
  const al = state.states.value?.slaves.find((item) => item.position === position);
  const hasMailbox = slave.coe || slave.eoe || slave.soe || slave.foe;
  // A file answers no questions to slaves.
  const isFile = state.hello.value.source === "file";
  const parts = PARTS.filter(([name]) => (name !== "files" || hasMailbox) && !(isFile && ["objects", "files", "memory"].includes(name)));
  const part = parts.some(([name]) => name === state.part.value) ? state.part.value : "now";
  return (
    <article class="slave" key={slave.position} aria-label={`Slave ${slave.position}`}>
      <header class="slave-head">
        <span class="slave-position">{slave.position}</span>
        <div>
          <h2>{slave.given_name || slave.name || "without a name"}</h2>
          {slave.given_name !== "" && <p class="muted">{slave.name}</p>}
        </div>
        {al !== undefined && <span class={`al ${health(al)}`}>{stateText(al.al_state)}</span>}
      </header>
      {al !== undefined && <Trouble state={state} al={al} />}
      <Tabs label={`Parts of slave ${slave.position}`} small tabs={parts} chosen={part} choose={(chosen) => (state.part.value = chosen)} />
      {part === "now" && <Now state={state} slave={slave} />}
      {part === "objects" && <Objects state={state} slave={slave} />}
      {part === "setup" && <SetUp state={state} slave={slave} />}
      {part === "health" && <Health state={state} slave={slave} />}
      {part === "files" && <Files state={state} slave={slave} />}
      {part === "memory" && <Memory state={state} slave={slave} />}
    </article>
  );
}

/** Why it is not in OP, and what to do. */
function Trouble({ state, al }: { state: State; al: AlState }) {
  const faults = state.states.value?.faults.filter((fault) => fault.slaves.includes(al.position)) ?? [];
  if (health(al) === "op" && faults.length === 0) return null;
  return (
    <div class={`note ${health(al) === "away" ? "" : "bad"}`}>
      {health(al) !== "op" && (
        <>
          <p><strong>{al.text}</strong></p>
          {al.recovery_text !== "" && <p>{al.recovery_text}</p>}
          {al.since !== null && <p class="muted">Since {clock(al.since)}, for {lasting(state.now.value - al.since)}.</p>}
        </>
      )}
      {faults.map((fault) => <p key={fault.kind}>{fault.text}</p>)}
    </div>
  );
}

function Now({ state, slave }: { state: State; slave: Slave }) {
  return (
    <>
      <ProcessData state={state} slave={slave} />
      <Section title="Identity">
        <Facts
          rows={[
            ["Vendor", hex(slave.vendor, 8)],
            ["Product", hex(slave.product, 8)],
            ["Revision", hex(slave.revision, 8)],
            ["Serial number", slave.serial === 0 ? "" : String(slave.serial)],
            ["Alias", slave.alias === 0 ? "" : String(slave.alias)],
            ["Identification", slave.identification === 0 ? "" : String(slave.identification)],
            ["Address", hex(slave.address, 4)],
            ["Optional", slave.group],
            ["Mailbox", [slave.coe && "CoE", slave.eoe && "EoE", slave.soe && "SoE", slave.foe && "FoE"].filter(Boolean).join(", ") || "none"],
            ["Profile", slave.profiles.map((item) => item.description).join("; ")],
            ["Clock", slave.dc_bits === 0 ? "none" : `${slave.dc_bits} bits, delay ${microseconds(slave.dc_delay_ns / 1000)}${slave.sync0_ns > 0 ? `, SYNC0 every ${microseconds(slave.sync0_ns / 1000)}` : ""}`],
            ["Watchdog", slave.watchdog_ms === null ? "" : slave.watchdog_ms === 0 ? "off" : `${slave.watchdog_ms} ms`],
            ["Modules", slave.modules.map((item, at) => `${at + 1}: ${item.name || hex(item.ident, 8)}`).join(", ")],
          ]}
        />
      </Section>
    </>
  );
}
