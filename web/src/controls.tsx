// Small parts that several panels use.
import type { ComponentChildren } from "preact";
import { useEffect, useState } from "preact/hooks";

import { AskError } from "./connection";

/** Rows of names and values. Rows without a value are left out. */
export function Facts({ rows }: { rows: [string, ComponentChildren][] }) {
  return (
    <dl class="facts">
      {rows.filter(([, value]) => value !== "" && value !== null && value !== undefined).map(([name, value]) => (
        <div key={name}>
          <dt>{name}</dt>
          <dd>{value}</dd>
        </div>
      ))}
    </dl>
  );
}

export function Section(props: { title: string; aside?: ComponentChildren; children: ComponentChildren }) {
  return (
    <section class="section">
      <h3>
        <span>{props.title}</span>
        {props.aside !== undefined && <span class="aside">{props.aside}</span>}
      </h3>
      {props.children}
    </section>
  );
}

/** Puts the focus on the panel, or another place, when it shows what was chosen. */
export function showPanel(place = "#panel [role='tabpanel']"): void {
  requestAnimationFrame(() => document.querySelector<HTMLElement>(place)?.focus());
}

/** Tabs as the ARIA practices describe them: arrows choose. */
export function Tabs<T extends string>(props: {
  label: string;
  tabs: readonly (readonly [T, string])[];
  chosen: T;
  choose(tab: T): void;
  small?: boolean;
}) {
  const { tabs, chosen, choose } = props;
  const move = (event: KeyboardEvent) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (step === undefined) return;
    event.preventDefault();
    const at = tabs.findIndex(([tab]) => tab === chosen);
    choose(tabs[(at + step + tabs.length) % tabs.length]![0]);
    const list = event.currentTarget as HTMLElement;
    requestAnimationFrame(() => list.querySelector<HTMLElement>('[aria-selected="true"]')?.focus());
  };
  return (
    <div class={props.small ? "tabs small" : "tabs"} role="tablist" aria-label={props.label} onKeyDown={move}>
      {tabs.map(([tab, title]) => (
        <button
          key={tab} type="button" role="tab" aria-selected={tab === chosen}
          tabIndex={tab === chosen ? 0 : -1} onClick={() => choose(tab)}
        >
          {title}
        </button>
      ))}
    </div>
  );
}

/** Why something could not be had. */
export function Trouble({ error }: { error: unknown }) {
  const text = error instanceof Error ? error.message : String(error);
  const name = error instanceof AskError ? error.failure.name : "";
  return <p class="trouble" role="alert">{text}{name !== "" && <span class="muted"> ({name})</span>}</p>;
}

export type Loaded<T> = { state: "loading" } | { state: "failed"; error: unknown } | { state: "there"; value: T };

/** Asks when `key` changes. An answer that comes too late is dropped. */
export function useAsked<T>(key: string, ask: () => Promise<unknown>): Loaded<T> {
  const [loaded, setLoaded] = useState<Loaded<T>>({ state: "loading" });
  useEffect(() => {
    let wanted = true;
    setLoaded({ state: "loading" });
    ask().then(
      (value) => wanted && setLoaded({ state: "there", value: value as T }),
      (error: unknown) => wanted && setLoaded({ state: "failed", error }),
    );
    return () => {
      wanted = false;
    };
  }, [key]);
  return loaded;
}

/** Gives a file to the user. */
export function save(bytes: Uint8Array, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([bytes as BlobPart]));
  link.download = name;
  link.click();
  URL.revokeObjectURL(link.href);
}
