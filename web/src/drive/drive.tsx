// The drive panel: state, mode, actual and target values; and with the right to write, moving it.
import { useEffect, useMemo, useState } from "preact/hooks";

import { Facts, Section } from "../controls";
import { Hand } from "../hands/hand";
import type { Signal } from "../protocol";
import type { State } from "../state";
import { hex, shortName, shown } from "../text";
import {
  type Axis, findAxes, homingFailed, HOMING, HOMING_START, isHome, MODES, remarks, signalsOf,
  STATE_NAMES, stateOf, towardsEnabled, VELOCITY_MODES,
} from "./cia402";
import { StateDiagram } from "./diagram";

export function DrivePanel({ state }: { state: State }) {
  const axes = useMemo(
    () => findAxes(state.signals.value, (slave) => state.slaveName(slave)),
    [state.signals.value, state.bus.value],
  );
  const [chosen, choose] = useState(0);
  const axis = axes.find((item) => item.slave === state.selected.value) ?? axes[chosen] ?? axes[0];
  useEffect(() => {
    state.live.want(axis === undefined ? [] : signalsOf(axis).map((item) => item.name));
    return () => state.live.want([]);
  }, [axis]);
  if (axis === undefined) {
    return <p class="empty">No slave of this bus has the statusword of a drive (CiA 402, object 0x6041) in its process data.</p>;
  }
  const select = (at: number) => {
    choose(at);
    state.selected.value = axes[at]!.slave;
  };
  return (
    <div class="drive">
      {axes.length > 1 && (
        <label class="drive-choice">Axis{" "}
          <select value={axes.indexOf(axis)} onChange={(event) => select(Number(event.currentTarget.value))}>
            {axes.map((item, at) => <option key={item.statusword.name} value={at}>{item.label}</option>)}
          </select>
        </label>
      )}
      <AxisView state={state} axis={axis} key={axis.statusword.name} />
    </div>
  );
}

function AxisView({ state, axis }: { state: State; axis: Axis }) {
  const values = state.live.values.value;
  const raw = (signal: Signal | null) => {
    const last = signal === null ? undefined : values.get(signal.name);
    return last === undefined ? null : Number(last.value);
  };
  const text = (signal: Signal | null) => {
    const last = signal === null ? undefined : values.get(signal.name);
    return signal === null ? "–" : last === undefined ? "…" : shown(signal, last.value);
  };
  const word = raw(axis.statusword);
  const present = word === null ? null : stateOf(word);
  const mode = raw(axis.mode) ?? raw(axis.modeWanted);
  const code = raw(axis.errorCode);
  /** Each quantity gets an axis: without units, that of positions would hide the others. */
  const draw = () => {
    for (const item of signalsOf(axis)) {
      if (item === axis.statusword || item === axis.controlword) continue;
      const pair = axis.pairs.find(({ target, actual }) => item === target || item === actual);
      state.scope.add(item.name, pair ? `${pair.title} of ${axis.label}` : `own ${item.name}`);
    }
  };
  const faults = state.states.value?.faults.filter((fault) => fault.kind === "drive" && fault.slaves.includes(axis.slave)) ?? [];
  return (
    <>
      <Section title={axis.label} aside={present === null ? "" : STATE_NAMES[present]}>
        {faults.map((fault) => <p key={fault.text} class="trouble">{fault.text}</p>)}
        {faults.length > 0 && <p class="actions"><button type="button" onClick={() => { state.part.value = "setup"; state.open(axis.slave); }}>Start-up parameters</button></p>}
        <StateDiagram present={present} />
        <Facts rows={[
          ["Statusword", word === null ? "" : `${hex(word, 4)}${remarks(word).map((item) => ` · ${item}`).join("")}`],
          ["Controlword", raw(axis.controlword) === null ? "" : hex(raw(axis.controlword)!, 4)],
          ["Mode", mode === null ? "" : MODES[mode] ?? `mode ${mode} of the manufacturer`],
          ["Error code", code === null || code === 0 ? "" : hex(code, 4)],
        ]} />
      </Section>
      <Section title="Values">
        <table>
          <thead><tr><th /><th class="number">Target</th><th class="number">Actual</th></tr></thead>
          <tbody>
            {axis.pairs.map(({ title, target, actual }) => (
              <tr key={title}><th scope="row">{title}</th><td class="number">{text(target)}</td><td class="number">{text(actual)}</td></tr>
            ))}
            {axis.others.map((item) => (
              <tr key={item.name}><th scope="row">{shortName(item)}</th><td /><td class="number">{text(item)}</td></tr>
            ))}
          </tbody>
        </table>
        <p class="actions">
          <button type="button" onClick={draw}>Draw these in the scope</button>
        </p>
      </Section>
      {state.may("outputs") && <Moving state={state} axis={axis} word={word} mode={mode} />}
    </>
  );
}

type Wish = "enable" | "forward" | "backward" | "home";

/** Moves a drive while somebody presses a button. The daemon lets go after 250 ms of silence. */
function Moving({ state, axis, word, mode }: { state: State; axis: Axis; word: number | null; mode: number | null }) {
  const hand = useMemo(() => {
    const made = new Hand(state.connection);
    made.isDeadMan = true;
    return made;
  }, []);
  const [wish, setWish] = useState<Wish | null>(null);
  const [speed, setSpeed] = useState("");
  useEffect(() => () => hand.release(), []);

  const velocityMode = axis.modeWanted !== null
    ? VELOCITY_MODES[0]! : mode !== null && VELOCITY_MODES.includes(mode) ? mode : null;
  const canJog = axis.velocity !== null && velocityMode !== null;
  const canHome = axis.modeWanted !== null;
  const present = word === null ? null : stateOf(word);
  const isFault = present === "fault";

  // Each new statusword may need another controlword.
  useEffect(() => {
    if (wish === null || axis.controlword === null) return;
    const towards = towardsEnabled(present);
    if (towards === null) {
      hand.release();
      setWish(null);
      return;
    }
    const values: [string, number | string][] = [];
    const isEnabled = present === "enabled";
    const starts = wish === "home" && isEnabled && mode === HOMING;
    values.push([axis.controlword.name, starts ? HOMING_START : towards]);
    if (axis.modeWanted !== null && wish !== "enable") {
      values.push([axis.modeWanted.name, wish === "home" ? HOMING : velocityMode!]);
    }
    if (axis.velocity !== null && wish !== "home") {
      const unit = axis.velocity.unit === "" ? "" : ` ${axis.velocity.unit}`;
      const moves = wish !== "enable" && isEnabled;
      values.push([axis.velocity.name, moves ? `${wish === "backward" ? "-" : ""}${speed || "0"}${unit}` : 0]);
    }
    hand.hold(values);
  }, [wish, present, mode, speed]);
  useEffect(() => {
    if (hand.trouble.value !== "") setWish(null);
  }, [hand.trouble.value]);

  const begin = (wanted: Wish) => (event: Event) => {
    event.preventDefault();
    (event.currentTarget as HTMLElement).focus();
    setWish(wanted);
  };
  const end = () => {
    hand.release();
    setWish(null);
  };
  const button = (wanted: Wish, title: string, possible: boolean) => (
    <button
      type="button" class={`hold ${wish === wanted ? "held" : ""}`} disabled={!possible || isFault} aria-pressed={wish === wanted}
      onPointerDown={begin(wanted)} onPointerUp={end} onPointerCancel={end} onPointerLeave={end} onBlur={end}
      onKeyDown={(event) => (event.key === " " || event.key === "Enter") && !event.repeat && begin(wanted)(event)}
      onKeyUp={end} onContextMenu={(event) => event.preventDefault()}
    >{title}</button>
  );
  const reset = () => {
    if (axis.controlword === null) return;
    hand.hold([[axis.controlword.name, 0x80]]);
    setTimeout(() => hand.release(), 300);
  };
  if (axis.controlword === null) return <p class="empty">The controlword (0x6040) is not in the process data, so the page cannot move this drive.</p>;
  return (
    <Section title="Move by hand" aside={hand.holds.value ? "holding" : "not holding"}>
      <p class="muted">The drive moves only while you press a button. 250 ms after the page falls silent, the daemon takes the outputs back and they become safe.</p>
      {canJog && (
        <label>Speed{" "}
          <input type="text" inputMode="decimal" value={speed} placeholder="0" onInput={(event) => setSpeed(event.currentTarget.value.replace(/[^0-9.eE+]/g, ""))} /> {axis.velocity!.unit}
        </label>
      )}
      <p class="actions">
        {button("enable", "Enable", true)}
        {button("backward", "◀ Jog", canJog && Number(speed) > 0)}
        {button("forward", "Jog ▶", canJog && Number(speed) > 0)}
        {button("home", "Home", canHome)}
        <button type="button" disabled={!isFault} onClick={reset}>Reset fault</button>
      </p>
      {!canJog && <p class="muted">Jogging needs a velocity mode: map 0x6060 and 0x60FF, or bring the drive to such a mode.</p>}
      {wish === "home" && word !== null && (isHome(word) || homingFailed(word)) && <p role="status">{homingFailed(word) ? "Homing failed." : "The drive has found its home."}</p>}
      {hand.trouble.value !== "" && <p class="trouble" role="alert">{hand.trouble.value}</p>}
    </Section>
  );
}
