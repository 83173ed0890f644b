// The top line: what operators ask first.
import type { Lamp } from "./protocol";
import type { State } from "./state";
import { showPanel } from "./controls";
import { clock, lasting } from "./text";

const WORDS = { good: "good", warning: "warning", bad: "bad", unknown: "not known" } as const;

/** The state also has a shape of its own, for those who do not see the colours. */
export function Mark({ state }: { state: Lamp["state"] }) {
  return (
    <svg class={`mark ${state}`} viewBox="0 0 12 12" aria-hidden="true">
      {state === "good" && <circle cx="6" cy="6" r="4" />}
      {state === "warning" && <path d="M6 1 11.5 11H.5Z" />}
      {state === "bad" && <rect x="1" y="1" width="10" height="10" />}
      {state === "unknown" && <circle cx="6" cy="6" r="3.5" class="hollow" />}
    </svg>
  );
}

export function Lamps({ state }: { state: State }) {
  const now = state.now.value;
  const isFresh = state.fresh.value;
  const open = ({ id, evidence }: Lamp) => {
    if (evidence.slave !== null) state.selected.value = evidence.slave;
    if (id === "link" && evidence.slave !== null) state.part.value = "health"; // the cables at the slave
    if (evidence.panel !== "topology") state.tab.value = evidence.panel;
    else if (evidence.slave !== null) state.tab.value = "slave";
    showPanel(evidence.panel === "topology" ? "#topology [tabindex='0']" : undefined);
  };
  return (
    <nav class="lamps" aria-label="State of the bus">
      {state.lamps.value.map((last) => (isFresh ? last : { ...last, state: "unknown" as const, since: null })).map((lamp) => (
        <button
          key={lamp.id} type="button" id={`lamp-${lamp.id}`} class={`lamp ${lamp.state}`}
          title={`${lamp.text}${lamp.since === null ? "" : ` Since ${clock(lamp.since)}.`}`}
          onClick={() => open(lamp)}
        >
          <span class="lamp-head">
            <Mark state={lamp.state} />
            <span class="lamp-title">{lamp.title}</span>
            <span class="sr">, {WORDS[lamp.state]}: </span>
            {lamp.since !== null && <span class="lamp-since">{lasting(now - lamp.since)}</span>}
          </span>
          <span class="lamp-text">{lamp.text}</span>
        </button>
      ))}
    </nav>
  );
}
