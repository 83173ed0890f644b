// The line above the curves: search, window, what is shown, files.
import { useSignal } from "@preact/signals";

import type { ScopeModel } from "./model";
import { toggleCursors } from "./screen";
import { search } from "./search";

const SPANS: [string, number][] = [
  ["0.1 s", 100], ["1 s", 1e3], ["5 s", 5e3], ["10 s", 1e4], ["30 s", 3e4], ["1 min", 6e4],
  ["5 min", 3e5], ["10 min", 6e5],
];

function Search({ model }: { model: ScopeModel }) {
  const query = useSignal("");
  const at = useSignal(0);
  const isOpen = useSignal(false);
  // It stays open, as several that match are often wanted.
  const drawn = model.curves.value.map(({ name }) => name);
  const others = [...model.known.value.values()].filter(({ name }) => !drawn.includes(name));
  const found = isOpen.value ? search(others, query.value, 12) : [];
  const choose = (name: string | undefined) => {
    if (name) model.add(name);
    at.value = Math.min(at.value, Math.max(0, found.length - 2));
  };
  return (
    <div class="scope-search" onFocusOut={(event: FocusEvent) => {
      if ((event.currentTarget as Node).contains(event.relatedTarget as Node | null)) return;
      isOpen.value = false;
      query.value = "";
    }}>
      <input
        type="text" role="combobox" aria-label="Add a signal" placeholder="Add a signal …"
        aria-expanded={found.length > 0} aria-controls="scope-found" aria-autocomplete="list"
        aria-activedescendant={found.length > 0 ? `scope-found-${at.value}` : undefined}
        value={query.value} onFocus={() => (isOpen.value = true)}
        onInput={(event) => {
          query.value = event.currentTarget.value;
          at.value = 0;
          isOpen.value = true;
        }}
        onKeyDown={(event) => {
          if (event.key === "ArrowDown") at.value = Math.min(found.length - 1, at.value + 1);
          else if (event.key === "ArrowUp") at.value = Math.max(0, at.value - 1);
          else if (event.key === "Enter") {
            choose(found[at.value]?.name);
            event.currentTarget.select();
          } else if (event.key === "Escape" && isOpen.value) isOpen.value = false;
          else return;
          event.preventDefault();
        }}
      />
      <ul id="scope-found" tabIndex={-1} role="listbox" aria-label="Signals that match" hidden={found.length === 0}>
        {found.map((each, i) => (
          <li key={each.name} id={`scope-found-${i}`} role="option" aria-selected={i === at.value}
            onMouseDown={(event: MouseEvent) => { event.preventDefault(); choose(each.name); }}>
            {each.label} <small>{each.name}{each.unit && `, ${each.unit}`}</small>
          </li>
        ))}
      </ul>
    </div>
  );
}

const Toggle = ({ on, text, act }: { on: boolean; text: string; act: () => void }) => (
  <button type="button" aria-pressed={on} onClick={act}>{text}</button>
);

export function Controls({ model }: { model: ScopeModel }) {
  const view = model.status.value?.view;
  const look = model.look.value;
  const names = model.curves.value.filter((curve) => !curve.hidden).map(({ name }) => name);
  const isFile = model.source.value === "file";
  const known = SPANS.some(([, span]) => span === view?.span);
  return (
    <div class="scope-controls" role="toolbar" aria-label="Scope">
      <Search model={model} />
      {!isFile && <Toggle on={view?.live ?? true} text="Live" act={() =>
        view?.live ? model.order({ do: "window", start: view.start, span: view.span }) : model.goLive()} />}
      <Toggle on={false} text="All" act={() => model.order({ do: "all" })} />
      <label>Window <select value={known ? view!.span : ""} onChange={(event) => {
        const span = Number(event.currentTarget.value);
        if (view?.live) model.goLive(span);
        else if (view) model.order({ do: "window", start: view.start + (view.span - span) / 2, span });
      }}>
        {!known && <option value="">own</option>}
        {SPANS.map(([text, span]) => <option key={text} value={span}>{text}</option>)}
      </select></label>
      <Toggle on={model.stacked.value} text="Stacked" act={() => model.arrange(!model.stacked.value)} />
      <Toggle on={model.cursors.value.length > 0} text="Cursors" act={() => toggleCursors(model)} />
      <Toggle on={model.trigger.value !== null} text="Trigger" act={() =>
        model.setTrigger(model.trigger.value ? null : {
          kind: "edge", source: names[0] ?? "", level: 0, upper: 0, slope: "rising", before: 0.5, mode: "normal",
        })} />
      <Toggle on={model.showsStatistics.value} text="Statistics" act={() => model.setStatistics(!model.showsStatistics.value)} />
      <Toggle on={look?.kind === "spectrum"} text="Spectrum" act={() =>
        model.setLook(look?.kind === "spectrum" ? null : { kind: "spectrum", names: names.slice(0, 1), window: "hann", decibel: false })} />
      <Toggle on={look?.kind === "xy"} text="XY" act={() =>
        model.setLook(look?.kind === "xy" ? null : { kind: "xy", x: names[0] ?? "", y: names[1] ?? names[0] ?? "" })} />
      <Toggle on={model.saves.value} text="Save" act={() => (model.saves.value = !model.saves.value)} />
    </div>
  );
}
