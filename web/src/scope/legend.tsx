// The table of signals: colours, values, cursors, statistics. It is the text of the picture, too.
import { numberText } from "./axes";
import type { Curve, Reading } from "./messages";
import type { ScopeModel } from "./model";

export function valueText({ value, name }: Reading): string {
  if (value === null) return "–";
  const text = typeof value === "string" ? value : numberText(value);
  return name ? `${name} (${text})` : text;
}

function difference(a: Reading | undefined, b: Reading | undefined): string {
  return typeof a?.value === "number" && typeof b?.value === "number" ? numberText(b.value - a.value) : "–";
}

/** A piece of a curve; SVG, since style attributes are not allowed. */
export const Swatch = ({ curve: { colour, dash } }: { curve: Curve }) => (
  <svg width="22" height="12" aria-hidden="true">
    <path d="M0 6H22" stroke={colour} stroke-width="4" stroke-dasharray={dash.join(" ") || undefined} />
  </svg>
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
  const [a = NaN, b = NaN] = model.status.value?.cycles ?? [];
  const [timeA = NaN, timeB = NaN] = model.cursors.value;
  // Numbers of cycles begin again when the daemon does.
  const isRun = (b - a) * (timeB - timeA) >= 0;
  return <>{isRun && ` · ${numberText(Math.abs(b - a))} cycles`}</>;
}

export function Legend({ model }: { model: ScopeModel }) {
  const curves = model.curves.value;
  const [a, b] = model.cursors.value;
  const hasCursors = a !== undefined && b !== undefined;
  if (curves.length === 0) return null;
  return (
    <div class={hasCursors ? "scope-legend scope-with-cursors" : "scope-legend"} tabIndex={0} role="region" aria-label="Signals of the scope">
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
                <th scope="row" title={`${curve.label} (${curve.name}), in files ${curve.recorded.path}`}><Swatch curve={curve} /> <span class="scope-label"><bdi>{curve.label}</bdi></span></th>
                <Values model={model} place={i} unit={curve.unit} hasCursors={hasCursors} />
                <td class="scope-row">
                  <span class="scope-more" aria-hidden="true">⋯</span>
                  <div class="scope-tools">
                    <button type="button" aria-pressed={curve.hidden} aria-label={`Hide ${curve.label}`} title="Hide" onClick={() => model.change(curve.name, { hidden: !curve.hidden })}>{curve.hidden ? "○" : "●"}</button>
                    <button type="button" aria-pressed={entry.axis !== ""} aria-label={`Own axis for ${curve.label}`} title="Own axis" onClick={() => model.change(curve.name, { axis: entry.axis ? "" : `own ${curve.name}` })}>↕</button>
                    {model.bitsOf(curve.name).length > 0 && !curve.digital && (
                      <select
                        aria-label={`Show a bit of ${curve.label}`} title="A lane for a bit" value=""
                        onChange={(event) => {
                          model.add(`${curve.name}.${event.currentTarget.value}`);
                          event.currentTarget.value = "";
                        }}
                      >
                        <option value="">bit</option>
                        {model.bitsOf(curve.name).map((text, bit) => <option key={bit} value={bit}>{text === `Bit ${bit}` ? text : `${bit}: ${text}`}</option>)}
                      </select>
                    )}
                    <label><span class="scope-hidden">Factor of {curve.label}</span>
                      <input type="number" step="any" value={entry.gain} title="Factor" onChange={(event) => {
                        const gain = Number(event.currentTarget.value);
                        if (gain && Number.isFinite(gain)) model.change(curve.name, { gain });
                      }} />
                    </label>
                    <button type="button" aria-label={`Remove ${curve.label}`} title="Remove" onClick={() => model.remove(curve.name)}>✕</button>
                  </div>
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
