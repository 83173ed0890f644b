// The process data of a slave, live.
import { Fragment } from "preact";
import { useEffect, useRef } from "preact/hooks";

import { Section } from "../controls";
import type { Slave } from "../maps";
import type { Signal } from "../protocol";
import type { State } from "../state";
import type { Last } from "../live";
import { counted, shortName, shown } from "../text";

const SETTLE_MS = 200;
const MANY_BITS = 4;

export function ProcessData({ state, slave }: { state: State; slave: Slave }) {
  const signals = state.bySlave.value.get(slave.position) ?? [];
  const box = useRef<HTMLDivElement>(null);
  // Only what is seen is asked for: all pages together may trace a limited number of signals.
  useEffect(() => {
    const seen = new Set<string>();
    let timer = 0;
    const observer = new IntersectionObserver((entries) => {
      for (const { target, isIntersecting } of entries) {
        const name = (target as HTMLElement).dataset["signal"]!;
        if (isIntersecting) seen.add(name);
        else seen.delete(name);
      }
      clearTimeout(timer);
      timer = setTimeout(() => state.live.want([...seen]), SETTLE_MS);
    });
    for (const row of box.current?.querySelectorAll("[data-signal]") ?? []) observer.observe(row);
    return () => {
      observer.disconnect();
      clearTimeout(timer);
      state.live.want([]);
    };
  }, [slave.position, signals]);
  const list = (output: boolean) => signals.filter((item) => item.output === output);
  if (signals.length === 0) return <Section title="Process data"><p class="empty">It exchanges no process data.</p></Section>;
  return (
    <div ref={box}>
      {([["Inputs", false], ["Outputs", true]] as const).map(([title, output]) => list(output).length > 0 && (
        <Section key={title} title={title} aside="drag into the scope, or +">
          <ul class="values">
            {channels(list(output)).map(({ name, values, bits }) => (
              <Fragment key={values[0]!.name}>
                {name !== "" && <li class="channel">{name}</li>}
                {values.map((item) => <Value key={item.name} state={state} item={item} />)}
                {bits.length > 0 && (
                  <li class="bits">
                    <details>
                      <summary>{counted(bits.length, "bit")}<span class="sr"> of {name || "the slave"}</span></summary>
                      <ul class="values">
                        {bits.map((item) => <Value key={item.name} state={state} item={item} />)}
                      </ul>
                    </details>
                  </li>
                )}
              </Fragment>
            ))}
          </ul>
        </Section>
      ))}
    </div>
  );
}

/** Values by channel (PDO). Where each has a value and many bits, the bits are folded. */
function channels(signals: Signal[]): { name: string; values: Signal[]; bits: Signal[] }[] {
  const groups = new Map<string, Signal[]>();
  for (const item of signals) {
    const pdo = item.path.split("/").slice(1, -1).join(" / ");
    groups.set(pdo, [...(groups.get(pdo) ?? []), item]);
  }
  return [...groups].map(([pdo, items]) => {
    const bits = items.filter((item) => item.bits === 1);
    const isBits = bits.length === items.length;
    const name = groups.size > 1 && !isBits ? pdo : "";
    return isBits || bits.length < MANY_BITS
      ? { name, values: items, bits: [] }
      : { name, values: items.filter((item) => item.bits !== 1), bits };
  });
}

function Value({ state, item }: { state: State; item: Signal }) {
  const last: Last | undefined = state.live.values.value.get(item.name);
  const named = last !== undefined && item.values[String(last.value)] !== undefined;
  const on = last !== undefined && Number(last.value) !== 0;
  return (
    <li
      draggable data-signal={item.name} title={`${item.name}  ${item.type}`} class={last?.old ? "old" : ""}
      onDragStart={(event) => {
        event.dataTransfer?.setData("text/x-ecatd-signal", item.name);
        event.dataTransfer?.setData("text/plain", item.name);
      }}
    >
      <button type="button" class="add" title="Show it in the scope" aria-label={`Show ${item.label} in the scope`} onClick={() => state.scope.add(item.name)}>+</button>
      <span class="value-name">{shortName(item)}</span>
      <span class="value-number">
        {last === undefined ? "–" : item.bits === 1 && !named ? <span class={on ? "bit on" : "bit"}>{on ? "on" : "off"}</span> : shown(item, last.value)}
      </span>
    </li>
  );
}
