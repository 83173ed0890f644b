// The state diagram of CiA 402, with the present state lit.
import { type DriveState, STATE_NAMES } from "./cia402";

const WIDTH = 132;
const HEIGHT = 26;
/** Left upper corners. Power is off above, and on below. */
const PLACES: Record<DriveState, [number, number]> = {
  not_ready: [10, 8],
  disabled: [10, 58],
  ready: [10, 108],
  switched_on: [10, 158],
  enabled: [10, 208],
  quick_stop: [178, 158],
  fault_reaction: [178, 8],
  fault: [178, 58],
};
const STEPS: [DriveState, DriveState][] = [
  ["not_ready", "disabled"], ["disabled", "ready"], ["ready", "switched_on"],
  ["switched_on", "enabled"], ["enabled", "quick_stop"], ["quick_stop", "disabled"],
  ["fault_reaction", "fault"], ["fault", "disabled"],
];
const BOTH_WAYS = new Set(["disabled ready", "ready switched_on", "switched_on enabled"]);

function path(from: DriveState, to: DriveState): string {
  const [x, y] = PLACES[from];
  const [u, v] = PLACES[to];
  if (x === u) return `M${x + WIDTH / 2} ${y + HEIGHT} V${v - 1}`;
  if (from === "enabled") return `M${x + WIDTH} ${y + HEIGHT / 2} H${u + WIDTH / 2} V${v + HEIGHT + 1}`;
  if (from === "quick_stop") return `M${x + WIDTH / 2} ${y} V${v + HEIGHT + 14} H${u + WIDTH + 14} V${v + HEIGHT - 6} H${u + WIDTH + 1}`;
  return `M${x} ${y + HEIGHT / 2} H${u + WIDTH + 1}`;
}

export function StateDiagram({ present }: { present: DriveState | null }) {
  const text = present === null ? "a state that no profile has" : STATE_NAMES[present];
  return (
    <svg class="drive-diagram" viewBox="0 0 320 242" role="img" aria-label={`State diagram of the drive: ${text}`}>
      <defs>
        <marker id="step" viewBox="0 0 6 6" refX="5" refY="3" markerWidth="6" markerHeight="6" orient="auto-start-reverse">
          <path d="M0 0 L6 3 L0 6 z" />
        </marker>
      </defs>
      {STEPS.map(([from, to]) => (
        <path
          key={`${from} ${to}`} class="step" d={path(from, to)} marker-end="url(#step)"
          {...(BOTH_WAYS.has(`${from} ${to}`) ? { "marker-start": "url(#step)" } : {})}
        />
      ))}
      {(Object.keys(PLACES) as DriveState[]).map((state) => {
        const [x, y] = PLACES[state];
        const kind = state === "fault" || state === "fault_reaction" ? "bad" : state === "enabled" ? "good" : "";
        return (
          <g key={state} class={`node ${kind} ${state === present ? "lit" : ""}`}>
            <rect x={x} y={y} width={WIDTH} height={HEIGHT} rx="4" />
            <text x={x + WIDTH / 2} y={y + HEIGHT / 2 + 4}>{STATE_NAMES[state]}</text>
          </g>
        );
      })}
    </svg>
  );
}
