// The table of signals: colours, values, cursors, statistics. It is the text of the picture, too.
import { numberText } from "./axes";
import type { Reading } from "./messages";
import type { ScopeModel } from "./model";

export function valueText({ value, name }: Reading): string {
  if (value === null) return "–";
  const text = typeof value === "string" ? value : numberText(value);
  return name ? `${name} (${text})` : text;
}

function difference(a: Reading | undefined, b: Reading | undefined): string {
  return typeof a?.value === "number" && typeof b?.value === "number" ? numberText(b.value - a.value) : "–";
}

/** A square in the colour of a curve; SVG, since style attributes are not allowed. */
export const Swatch = ({ colour }: { colour: string }) => (
  <svg width="12" height="12" aria-hidden="true"><rect width="12" height="12" rx="3" fill={colour} /></svg>
);

/** On its own, so that what is being typed beside it is not set back with each report. */
function Values({ model, place, unit, hasCursors }: {
  model: ScopeModel; place: number; unit: string; hasCursors: boolean;
}) {
  const [now, atA, atB] = model.status.value?.readings[place] ?? [];
  return (
    <>
      <td class={now?.old ? "scope-old" : undefined} title={now?.old ? "Old: the slave took no part in the cycle" : undefined}>
        {now ? valueText(now) : "–"} <small>{unit}</small>
      </td>
      {hasCursors && <>
        <td>{atA ? valueText(atA) : "–"}</td><td>{atB ? valueText(atB) : "–"}</td>
        <td>{difference(atA, atB)}</td>
      </>}
    </>
  );
}

function Cycles({ model }: { model: ScopeModel }) {
  const [a, b] = model.status.value?.cycles ?? [];
  return <>{a !== undefined && b !== undefined && ` · ${numberText(b - a)} cycles`}</>;
}

export function Legend({ model }: { model: ScopeModel }) {
  const curves = model.curves.value;
  const [a, b] = model.cursors.value;
  const hasCursors = a !== undefined && b !== undefined;
  if (curves.length === 0) return null;
  return (
    <div class="scope-legend" tabIndex={0} role="region" aria-label="Signals of the scope">
      <table>
        <thead>
          <tr>
            <th scope="col">Signal</th><th scope="col">Value</th>
            {hasCursors && <><th scope="col">A</th><th scope="col">B</th><th scope="col">B − A</th></>}
            <th scope="col"><span class="scope-hidden">Change</span></th>
          </tr>
        </thead>
        <tbody>
          {curves.map((curve, i) => {
            const entry = model.entries.value.find(({ name }) => name === curve.name)!;
            return (
              <tr
                key={curve.name} class={curve.hidden ? "scope-off" : undefined}
                onMouseEnter={() => model.emphasise(curve.name)} onMouseLeave={() => model.emphasise(null)}
              >
                <th scope="row" title={curve.name}><Swatch colour={curve.colour} /> {curve.label}</th>
                <Values model={model} place={i} unit={curve.unit} hasCursors={hasCursors} />
                <td class="scope-row">
                  <button type="button" aria-pressed={curve.hidden} aria-label={`Hide ${curve.label}`} title="Hide" onClick={() => model.change(curve.name, { hidden: !curve.hidden })}>{curve.hidden ? "○" : "●"}</button>
                  <button type="button" aria-pressed={entry.axis !== ""} aria-label={`Own axis for ${curve.label}`} title="Own axis" onClick={() => model.change(curve.name, { axis: entry.axis ? "" : `own ${curve.name}` })}>↕</button>
                  <label><span class="scope-hidden">Factor of {curve.label}</span>
                    <input type="number" step="any" value={entry.gain} title="Factor" onChange={(event) => {
                      const gain = Number(event.currentTarget.value);
                      if (gain && Number.isFinite(gain)) model.change(curve.name, { gain });
                    }} />
                  </label>
                  <button type="button" aria-label={`Remove ${curve.label}`} title="Remove" onClick={() => model.remove(curve.name)}>✕</button>
                </td>
              </tr>
            );
          })}
        </tbody>
      </table>
      {hasCursors && (
        <p class="scope-delta">
          Δt {numberText(Number((b - a).toPrecision(7)))} ms · 1/Δt {numberText(1000 / Math.abs(b - a))} Hz
          <Cycles model={model} />
        </p>
      )}
    </div>
  );
}
