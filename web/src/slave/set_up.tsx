// How a slave was set up, and how it differs from what the configuration expects.
import { Facts, Section, Trouble, useAsked } from "../controls";
import type { Slave } from "../maps";
import type { State } from "../state";
import { hex } from "../text";

interface Device {
  position: number | null;
  name: string | null;
  vendor: number | null;
  product: number | null;
  revision: number | null;
  serial: number | null;
}

type Table = Record<string, unknown>;

/** The table of a slave in the configuration: by its position, or its place among the tables. */
function tableOf(config: Table, slave: Slave): Table | undefined {
  const tables = (config["slave"] as Table[] | undefined) ?? [];
  return tables.find((table, at) => (table["position"] ?? at) === slave.position);
}

function said(value: unknown): string {
  if (typeof value === "object" && value !== null) return JSON.stringify(value);
  return String(value);
}

export function SetUp({ state, slave }: { state: State; slave: Slave }) {
  const config = state.of("ro/config").value.value;
  const wire = useAsked<{ devices: Device[] }>(`ro/wire#${slave.position}`, () => state.connection.ask("ro/wire"));
  const states = state.states.value;
  const table = config === null ? undefined : tableOf(config.config as Table, slave);
  const startup = (table?.["startup"] as Table[] | undefined) ?? [];
  const others = Object.entries(table ?? {}).filter(([name]) => name !== "startup");
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
        {wire.state === "failed" && <Trouble error={wire.error} />}
        {wire.state === "loading" ? <p class="empty">Asking what is on the wire …</p> : device === undefined ? <p class="empty">It is not on the wire now.</p> : (
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
      <Section title="Start-up list" aside={startup.length > 0 ? String(startup.length) : undefined}>
        {startup.length === 0 ? <p class="empty">The configuration writes no objects of this slave at the start.</p> : (
          <ul class="values">
            {startup.map((item, at) => (
              <li key={at}>
                <span class="value-name">{typeof item["index"] === "number" ? hex(item["index"], 4) : said(item["index"] ?? item["object"] ?? "")}{item["subindex"] === undefined ? "" : `:${said(item["subindex"])}`}</span>
                <span class="value-number">{said(item["value"] ?? item["data"] ?? "")}</span>
              </li>
            ))}
          </ul>
        )}
      </Section>
      <Section title="Configuration">
        {others.length === 0 ? <p class="empty">The configuration has nothing about this slave: all is as the slave says.</p>
          : <Facts rows={others.map(([name, value]) => [name, <code key={name}>{said(value)}</code>])} />}
      </Section>
    </>
  );
}
