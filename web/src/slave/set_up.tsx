// How a slave was set up, and how it differs from what the configuration expects.
import { Facts, Section, Trouble, useAsked } from "../controls";
import type { Sdo, Slave } from "../maps";
import type { State } from "../state";
import { hex } from "../text";
import { decoded, typeOf } from "./coe";

interface Device {
  position: number | null;
  name: string | null;
  vendor: number | null;
  product: number | null;
  revision: number | null;
  serial: number | null;
}

type Table = Record<string, unknown>;

/** The table of a slave in the configuration, and its place: by its position, or the order. */
function tableOf(config: Table, slave: Slave): [number, Table | undefined] {
  const tables = (config["slave"] as Table[] | undefined) ?? [];
  const place = tables.findIndex((table, at) => (table["position"] ?? at) === slave.position);
  return [place, tables[place]];
}

function said(value: unknown): string {
  if (typeof value === "object" && value !== null) return JSON.stringify(value);
  return String(value);
}

export function SetUp({ state, slave }: { state: State; slave: Slave }) {
  const config = state.of("ro/config").value.value;
  const wire = useAsked<{ devices: Device[] }>(`ro/wire#${slave.position}`, () => state.connection.ask("ro/wire"));
  const states = state.states.value;
  const [place, table] = config === null ? [-1, undefined] : tableOf(config.config as Table, slave);
  const startup = (table?.["startup"] as Table[] | undefined) ?? [];
  // What nobody has written is as it always is; `[[slave.startup]]` is shown above.
  const isWritten = (name: string) => Object.keys(config?.origins ?? {}).some((key) => key.split(/[.[]/).slice(0, 3).join() === `slave,${place}],${name}`);
  const others = Object.entries(table ?? {}).filter(([name, value]) => name !== "startup" && value != null && isWritten(name));
  const device = wire.state === "there" ? wire.value.devices.find((item) => item.position === slave.position) : undefined;
  const rows = (["vendor", "product", "revision", "serial"] as const).map((name) => {
    const found = device?.[name];
    return { name, expected: slave[name], found, differs: found != null && found !== slave[name] };
  });
  const missing = states?.missing.filter((item) => item.expected.includes(slave.position)) ?? [];
  return (
    <>
      <Section title="Expected and found">
        {[...slave.problems, ...missing.map((item) => item.text), states?.others ?? ""].filter((text) => text !== "").map((text) => (
          <p class="note warning" key={text}>{text}</p>
        ))}
        {wire.state === "failed" ? <Trouble error={wire.error} /> : wire.state === "loading" ? <p class="empty">Asking what is on the wire …</p> : device === undefined ? <p class="empty">It is not on the wire now.</p> : (
          <table>
            <thead><tr><th></th><th class="number">At the start</th><th class="number">On the wire</th></tr></thead>
            <tbody>
              {rows.map(({ name, expected, found, differs }) => (
                <tr key={name}>
                  <th scope="row">{name}</th>
                  <td class="number">{hex(expected, 8)}</td>
                  <td class={`number ${differs ? "text-warn" : ""}`}>{found == null ? "–" : hex(found, 8)}</td>
                </tr>
              ))}
            </tbody>
          </table>
        )}
      </Section>
      <Section title="Start-up list" aside={startup.length > 0 ? "configured · the slave has" : undefined}>
        {startup.length === 0 ? <p class="empty">The configuration writes no objects of this slave at the start.</p> : (
          <ul class="values">
            {startup.map((item, at) => {
              const name = `slave[${place}].startup[${at}]`;
              const origin = config?.origins[name] ?? config?.origins[`${name}.object`] ?? "";
              return <Parameter key={`${slave.position}/${at}`} state={state} slave={slave} item={item} origin={origin} />;
            })}
          </ul>
        )}
      </Section>
      <Section title="Configuration">
        {others.length === 0 ? <p class="empty">The configuration has nothing about this slave: all is as the slave says.</p>
          : <Facts rows={others.map(([name, value]) => [name, <code key={name}>{typeof value === "number" && /^(vendor|product|revision|serial)/.test(name) ? hex(value, 8) : said(value)}</code>])} />}
      </Section>
    </>
  );
}

/** A start-up parameter beside what the slave has now. */
function Parameter({ state, slave, item, origin }: { state: State; slave: Slave; item: Table; origin: string }) {
  const object = said(item["object"]);
  const [index, subindex] = object.split(":");
  const found = useAsked<Sdo>(`${slave.position}/${object}`, () =>
    state.connection.ask(`ro/sdo/${slave.position}/${index}/${Number.parseInt(subindex ?? "0", 16)}`, item["complete"] === true ? { complete: true } : {}));
  const unit = item["unit"] == null ? "" : ` ${said(item["unit"])}`;
  const configured = `${said(item["value"] ?? item["hex"])}${unit}`;
  let has = "…", differs = false;
  if (found.state === "failed") has = "not readable";
  else if (found.state === "there") {
    const { data, scale = 1, offset = 0 } = found.value;
    const type = typeof item["type"] === "string" ? typeOf(item["type"]) : 0;
    const bytes = typeof item["hex"] === "string" ? item["hex"].replace(/[^0-9a-f]/gi, "").toLowerCase() : null;
    has = decoded(data, type, unit === "" ? 1 : scale, unit === "" ? 0 : offset, unit.trim());
    const [wanted, raw] = [Number(item["value"]), Number(decoded(data, type).split(" ")[0])];
    if (bytes !== null) differs = !data.startsWith(bytes);
    else if (Number.isFinite(wanted) && Number.isFinite(raw)) differs = Math.abs((unit === "" ? raw : raw * scale + offset) - wanted) > (unit === "" ? 0 : Math.abs(scale));
    else if (unit === "") differs = has !== configured;
  }
  const notes = [item["transition"], item["optional"] === true ? "optional" : "", item["comment"], origin, found.state === "failed" && found.error instanceof Error ? found.error.message : ""];
  return (
    <li>
      <span class="value-name"><code>{object}</code></span>
      <span class="value-number">{configured} <span class="muted">·</span> <span class={differs ? "text-warn" : "muted"}>{has}{differs && " differs"}</span></span>
      <span class="value-note">{notes.filter((note) => note != null && note !== "").map(String).join(" · ")}</span>
    </li>
  );
}
