// What opens below the curves: trigger, statistics, spectrum, XY, files.
import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";

import { numberText } from "./axes";
import { Swatch } from "./legend";
import type { Format, Look } from "./messages";
import type { ScopeModel } from "./model";
import { WINDOW_FUNCTIONS } from "./spectrum";
import type { Trigger } from "./trigger";

const FORMATS: [Format, string][] = [["csv", "CSV"], ["mcap", "MCAP"], ["png", "PNG"], ["svg", "SVG"]];

function Choice<T extends string>({ label, value, choices, act }: {
  label: string; value: T; choices: readonly (T | [T, string])[]; act: (value: T) => void;
}) {
  return (
    <label>{label} <select value={value} onChange={(event) => act(event.currentTarget.value as T)}>
      {choices.map((each) => {
        const [key, text] = typeof each === "string" ? [each, each] : each;
        return <option key={key} value={key}>{text}</option>;
      })}
    </select></label>
  );
}

function Num({ label, value, act }: { label: string; value: number; act: (value: number) => void }) {
  return (
    <label>{label} <input type="number" step="any" value={value} onChange={(event) => {
      const number = event.currentTarget.valueAsNumber;
      if (Number.isFinite(number)) act(number);
    }} /></label>
  );
}

const STATES = {
  off: "", waits: "waits for the trigger", collects: "triggered, the window fills",
  holds: "holds the picture",
};

/** On its own, so that what is being typed beside it is not set back with each report. */
const TriggerState = ({ model }: { model: ScopeModel }) => (
  <span role="status">{STATES[model.status.value?.trigger ?? "off"]}</span>
);

function TriggerPanel({ model, trigger }: { model: ScopeModel; trigger: Trigger }) {
  const set = (change: Partial<Trigger>) => model.setTrigger({ ...trigger, ...change });
  const curves = model.curves.value.map(({ name, label }): [string, string] => [name, label]);
  const kinds = [...new Set(model.marks.value.map(({ kind }) => kind))].sort();
  const slopes: Record<Trigger["kind"], [Trigger["slope"], string][]> = {
    edge: [["rising", "rising"], ["falling", "falling"], ["both", "both"]],
    level: [["rising", "at or above"], ["falling", "at or below"]],
    window: [["rising", "leaves"], ["falling", "enters"], ["both", "both"]],
    event: [],
  };
  return (
    <div class="scope-panel" role="group" aria-label="Trigger">
      <Choice label="Trigger" value={trigger.kind} choices={["edge", "level", "window", "event"]}
        act={(kind) => set({ kind, slope: "rising", source: kind === "event" ? "" : curves[0]?.[0] ?? "" })} />
      {trigger.kind === "event"
        ? <Choice label="Event" value={trigger.source} choices={[["", "any"] as [string, string], ...kinds]} act={(source) => set({ source })} />
        : <Choice label="Signal" value={trigger.source} choices={curves} act={(source) => set({ source })} />}
      {trigger.kind !== "event" && <Choice label="When" value={trigger.slope} choices={slopes[trigger.kind]} act={(slope) => set({ slope })} />}
      {trigger.kind !== "event" && <Num label={trigger.kind === "window" ? "From" : "Level"} value={trigger.level} act={(level) => set({ level })} />}
      {trigger.kind === "window" && <Num label="to" value={trigger.upper} act={(upper) => set({ upper })} />}
      <label>Before it {Math.round(trigger.before * 100)} % <input type="range" min="0" max="1" step="0.05" value={trigger.before} onChange={(event) => set({ before: event.currentTarget.valueAsNumber })} /></label>
      <Choice label="Mode" value={trigger.mode} choices={["auto", "normal", "single"]} act={(mode) => set({ mode })} />
      <button type="button" onClick={() => set({})}>Arm again</button>
      <TriggerState model={model} />
    </div>
  );
}

function StatisticsPanel({ model }: { model: ScopeModel }) {
  const found = model.statistics.value;
  return (
    <div class="scope-panel" role="region" tabIndex={0} aria-label="Statistics">
      <table>
        <caption>
          {model.cursors.value.length === 2 ? "Between the cursors" : "In the window"}: {found ? numberText(found.span / 1000) : "–"} s
        </caption>
        <thead><tr>{["Signal", "Minimum", "Maximum", "Mean", "RMS", "Standard deviation", "Peak to peak", "Samples", "Old", "Missing"].map((text) => <th key={text} scope="col">{text}</th>)}</tr></thead>
        <tbody>{found?.rows.map((row) => {
          const curve = model.curves.value.find(({ name }) => name === row.name);
          return curve && (
            <tr key={row.name}><th scope="row"><Swatch curve={curve} /> {curve.label}</th>
              {[row.min, row.max, row.mean, row.rms, row.deviation, row.peakToPeak].map((value, i) => <td key={i}>{Number.isNaN(value) ? "–" : numberText(value)} <small>{curve.unit}</small></td>)}
              <td>{row.count}</td><td>{row.old}</td><td>{row.missing}</td></tr>
          );
        })}</tbody>
      </table>
    </div>
  );
}

function LookPanel({ model, look }: { model: ScopeModel; look: Look }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const element = canvas.current!;
    const { clientWidth: width, clientHeight: height } = element;
    const offscreen = element.transferControlToOffscreen();
    model.order({ do: "detail", canvas: offscreen, width, height, ratio: devicePixelRatio }, [offscreen]);
  }, []);
  const curves = model.curves.value.map(({ name, label }): [string, string] => [name, label]);
  return (
    <div class="scope-panel scope-look" role="group" aria-label={look.kind === "xy" ? "XY" : "Spectrum"}>
      <div>
        {look.kind === "xy" ? <>
          <Choice label="X" value={look.x} choices={curves} act={(x) => model.setLook({ ...look, x })} />
          <Choice label="Y" value={look.y} choices={curves} act={(y) => model.setLook({ ...look, y })} />
        </> : <>
          <Choice label="Signal" value={look.names[0] ?? ""} choices={curves} act={(name) => model.setLook({ ...look, names: [name] })} />
          <Choice label="Window" value={look.window} choices={WINDOW_FUNCTIONS} act={(window) => model.setLook({ ...look, window })} />
          <label><input type="checkbox" checked={look.decibel} onChange={(event) => model.setLook({ ...look, decibel: event.currentTarget.checked })} /> dB</label>
          {model.spectra.value.map((row) => (
            <div key={row.name}>
              <table><caption>Greatest amplitudes</caption><tbody>
                {row.peaks.map(({ frequency, amplitude }) => <tr key={frequency}><td>{numberText(Number(frequency.toPrecision(6)))} Hz</td><td>{numberText(amplitude)}</td></tr>)}
              </tbody></table>
              <small>{row.count} samples at {numberText(Number(row.rate.toPrecision(5)))} Hz{row.held > 0 ? `, ${row.held} of them held over missing cycles` : ""}</small>
            </div>
          ))}
        </>}
      </div>
      <canvas ref={canvas} role="img" aria-label={look.kind === "xy" ? "One signal over another" : "Amplitudes over frequency; the table has the greatest"} />
    </div>
  );
}

function SavePanel({ model }: { model: ScopeModel }) {
  const format = useSignal<Format>("csv");
  const open = (file: File | undefined) => {
    // A longer one is no layout, and `open` says so.
    void file?.slice(0, 1e6 + 1).text().then((text) => model.open(text));
  };
  return (
    <div class="scope-panel" role="group" aria-label="Files">
      <Choice label="Format" value={format.value} choices={FORMATS} act={(chosen) => (format.value = chosen)} />
      <button type="button" disabled={model.saving.value} onClick={() => model.save(format.value, false)}>Save the window</button>
      <button type="button" disabled={model.saving.value} onClick={() => model.save(format.value, true)}>Save all</button>
      <button type="button" onClick={() => model.saveLayout()}>Save layout</button>
      <label class="scope-open">Open layout <input type="file" accept=".json" onChange={(event) => open(event.currentTarget.files?.[0])} /></label>
    </div>
  );
}

export function Panels({ model }: { model: ScopeModel }) {
  const trigger = model.trigger.value;
  const look = model.look.value;
  return (
    <>
      {trigger && <TriggerPanel model={model} trigger={trigger} />}
      {model.showsStatistics.value && <StatisticsPanel model={model} />}
      {model.saves.value && <SavePanel model={model} />}
      {look && <LookPanel key={look.kind} model={model} look={look} />}
    </>
  );
}
