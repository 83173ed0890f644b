// The object dictionary of a slave: browse, read, and with the right `sdo` write.
import { useEffect, useState } from "preact/hooks";

import { Section, Trouble, useAsked } from "../controls";
import type { ObjectDescription, ObjectEntry, Sdo, Slave } from "../maps";
import type { State } from "../state";
import { hex } from "../text";
import { decoded, readable, typeName, writable } from "./coe";

const AREAS: [number, string][] = [
  [0x1000, "Communication"], [0x2000, "Manufacturer"], [0x6000, "Profile"], [0xa000, "Other"], [0xf000, "Device"],
];

export function Objects({ state, slave }: { state: State; slave: Slave }) {
  const key = `ro/objects/${slave.position}`;
  const loaded = useAsked<{ objects: number[] }>(key, () =>
    slave.coe ? state.connection.ask(key) : Promise.resolve({ objects: [] }));
  const [names, setNames] = useState<ReadonlyMap<number, ObjectDescription>>(new Map());
  const [search, setSearch] = useState("");
  const [opened, setOpened] = useState<number | null>(null);
  const objects = loaded.state === "there" ? loaded.value.objects : [];
  // One description after the other: others wait for the mailbox of the slave, too.
  useEffect(() => {
    let wanted = true;
    void (async () => {
      const found = new Map<number, ObjectDescription>();
      for (const index of objects) {
        try {
          found.set(index, (await state.connection.ask(`${key}/${hex(index, 4)}`)) as unknown as ObjectDescription);
        } catch {
          // The entry says it when it is opened.
        }
        if (!wanted) return;
        if (found.size % 8 === 0 || index === objects.at(-1)) setNames(new Map(found));
      }
    })();
    return () => {
      wanted = false;
    };
  }, [objects]);
  if (!slave.coe) return <p class="empty">The slave has no objects: it does not answer CoE.</p>;
  if (loaded.state === "loading") return <p class="empty">Asking the slave for its objects …</p>;
  if (loaded.state === "failed") return <Trouble error={loaded.error} />;
  const wanted = search.toLowerCase();
  const found = objects.filter((index) => `${hex(index, 4)} ${names.get(index)?.name ?? ""}`.toLowerCase().includes(wanted));
  return (
    <div class="objects">
      <div class="toolbar"><input type="search" placeholder={`Search ${objects.length} objects`} aria-label="Search objects" value={search} onInput={(e) => setSearch(e.currentTarget.value)} /></div>
      {AREAS.map(([from, title], at) => {
        const until = AREAS[at + 1]?.[0] ?? 0x10000;
        const here = found.filter((index) => index >= from && index < until);
        return here.length > 0 && (
          <Section key={title} title={title} aside={String(here.length)}>
            <ul class="object-list">
              {here.map((index) => (
                <li key={index}>
                  <button type="button" class="object" aria-expanded={opened === index} onClick={() => setOpened(opened === index ? null : index)}>
                    <code>{hex(index, 4)}</code> <span>{names.get(index)?.name ?? ""}</span>
                  </button>
                  {opened === index && <Opened state={state} slave={slave} index={index} />}
                </li>
              ))}
            </ul>
          </Section>
        );
      })}
    </div>
  );
}

function Opened({ state, slave, index }: { state: State; slave: Slave; index: number }) {
  const key = `ro/objects/${slave.position}/${hex(index, 4)}`;
  const loaded = useAsked<ObjectDescription>(key, () => state.connection.ask(key));
  if (loaded.state === "loading") return <p class="empty">Asking …</p>;
  if (loaded.state === "failed") return <Trouble error={loaded.error} />;
  return (
    <ul class="entries">
      {loaded.value.entries.map((entry) => <EntryRow key={entry.subindex} state={state} slave={slave} index={index} entry={entry} />)}
    </ul>
  );
}

function EntryRow(props: { state: State; slave: Slave; index: number; entry: ObjectEntry }) {
  const { state, slave, index, entry } = props;
  const path = `${slave.position}/${hex(index, 4)}/${entry.subindex}`;
  const [reading, setReading] = useState(0);
  const [text, setText] = useState<string | null>(null);
  const [error, setError] = useState<unknown>(null);
  const loaded = useAsked<Sdo | null>(`${path}#${reading}`, () =>
    readable(entry.access) ? state.connection.ask(`ro/sdo/${path}`) : Promise.resolve(null));
  const sdo = loaded.state === "there" ? loaded.value : null;
  const value = sdo === null ? "" : decoded(sdo.data, sdo.data_type || entry.data_type, sdo.scale, sdo.offset, sdo.unit);
  const write = async (event: Event) => {
    event.preventDefault();
    const address = `${hex(index, 4)}:${hex(entry.subindex, 2).slice(2)}`;
    if (!confirm(`Write ${text} to ${address} (${entry.name}) of slave ${slave.position} ${state.slaveName(slave.position)}? It has ${value || "an unknown value"} now.`)) return;
    try {
      await state.connection.ask(`rw/sdo/${path}`, {}, { value: text });
      setText(null);
      setError(null);
      setReading(reading + 1);
    } catch (failure) {
      setError(failure);
    }
  };
  return (
    <li class="entry">
      <span class="entry-sub">{entry.subindex}</span>
      <span class="entry-name" title={`${typeName(entry.data_type)}, ${entry.bit_length} bits`}>{entry.name || typeName(entry.data_type)}</span>
      <span class="entry-value">
        {!readable(entry.access) ? <span class="muted">not readable</span>
          : loaded.state === "loading" ? "…"
          : loaded.state === "failed" ? <span class="text-bad">{loaded.error instanceof Error ? loaded.error.message : ""}</span>
          : <button type="button" class="link value-link" title="Read again" onClick={() => setReading(reading + 1)}>{value === "" ? "empty" : value}</button>}
      </span>
      {state.may("sdo") && writable(entry.access) && text === null && <button type="button" class="quiet entry-write" onClick={() => setText("")}>write</button>}
      {text !== null && (
        <form class="entry-form" onSubmit={(event) => void write(event)}>
          <input aria-label={`New value of ${entry.name}`} value={text} autoFocus onInput={(e) => setText(e.currentTarget.value)} />
          <button type="submit" class="do" disabled={text === ""}>Write</button>
          <button type="button" class="quiet" onClick={() => setText(null)}>Leave</button>
        </form>
      )}
      {error !== null && <Trouble error={error} />}
    </li>
  );
}
