// Error counters of the ports, the cables, and the diagnosis history of a slave.
import { useState } from "preact/hooks";

import { AskError } from "../connection";
import { Section, Trouble, useAsked } from "../controls";
import type { PortErrors, Sdo, Slave } from "../maps";
import type { State } from "../state";
import { clock, grouped } from "../text";
import { bytesOf } from "./coe";
import { type DiagnosisMessage, parseMessage, places } from "./diagnosis";

const HISTORY = "0x10F3";

export function Health({ state, slave }: { state: State; slave: Slave }) {
  const { value: errors, failure } = state.of("ro/errors").value;
  const counters = errors?.slaves.find((item) => item.position === slave.position);
  const links = errors?.links?.filter((link) => link.slave === slave.position || link.before === slave.position) ?? [];
  // While a ring is open, only the cables say what they lead to.
  const leadsTo = ({ port, to }: PortErrors) => {
    const link = links.find((it) => (it.slave === slave.position ? it.port : it.before_port) === port);
    const other = to?.[0] ?? (link?.slave === slave.position ? link.before : link?.slave);
    return other === undefined ? undefined : other < 0 ? "master" : state.slaveName(other);
  };
  return (
    <>
      <Section title="Cables">
        {links.length === 0 ? <p class="empty">{failure?.message ?? "Nothing is known about its cables."}</p> : links.map((link) => (
          <p key={`${link.slave}/${link.port}`} class={`note cable-note ${link.verdict === "bad" ? "bad" : link.verdict === "strained" ? "warning" : ""}`}>
            <strong>{link.verdict === "unknown" ? "not known yet" : link.verdict}</strong> {link.text}
          </p>
        ))}
      </Section>
      <Section title="Error counters" aside={counters?.since == null ? undefined : `since ${clock(counters.since)}`}>
        {counters === undefined ? <p class="empty">{failure?.message ?? "The slave does not answer."}</p> : (
          <table>
            <thead><tr><th>Port</th><th>Leads to</th><th class="number">Invalid</th><th class="number">Physical</th><th class="number">Forwarded</th><th class="number">Lost</th></tr></thead>
            <tbody>
              {counters.ports.map((port) => (
                <tr key={port.port}>
                  <th scope="row">{port.port}</th>
                  <td>{leadsTo(port) ?? <span class="muted">–</span>}</td>
                  {([port.invalid, port.physical, port.forwarded, port.lost_links] as const).map((count, at) => (
                    <td key={at} class={`number ${count > 0 ? "text-warn" : "muted"}`}>{grouped(count)}</td>
                  ))}
                </tr>
              ))}
            </tbody>
          </table>
        )}
        {counters !== undefined && (counters.processing > 0 || counters.pdi > 0) && (
          <p class="muted">Processing unit: {grouped(counters.processing)} errors. Process data interface: {grouped(counters.pdi)}.</p>
        )}
      </Section>
      {slave.coe && <History state={state} slave={slave} />}
    </>
  );
}

function History({ state, slave }: { state: State; slave: Slave }) {
  const [reading, setReading] = useState(0);
  const read = async (subindex: number) =>
    bytesOf(((await state.connection.ask(`ro/sdo/${slave.position}/${HISTORY}/${subindex}`)) as unknown as Sdo).data);
  const loaded = useAsked<DiagnosisMessage[]>(`${slave.position}#${reading}`, async () => {
    const [most, newest] = [(await read(1))[0] ?? 0, (await read(2))[0] ?? 0];
    const found: DiagnosisMessage[] = [];
    for (const subindex of places(newest, most)) {
      const message = parseMessage(await read(subindex));
      if (message !== null) found.push(message);
    }
    return found;
  });
  const none = loaded.state === "failed" && loaded.error instanceof AskError && loaded.error.failure.name === "sdo_abort";
  return (
    <Section title="Diagnosis history" aside={<button type="button" class="link" onClick={() => setReading(reading + 1)}>read again</button>}>
      {loaded.state === "loading" && <p class="empty">Asking the slave …</p>}
      {loaded.state === "failed" && (none ? <p class="empty">The slave keeps no diagnosis history (object 0x10F3).</p> : <Trouble error={loaded.error} />)}
      {loaded.state === "there" && (loaded.value.length === 0 ? <p class="empty">It is empty.</p> : (
        <ol class="event-list">
          {loaded.value.map((message, at) => (
            <li key={at} class={`event ${message.kind}`}><div class="event-body">
              <span class="event-when"><time>{message.when}</time></span>
              <span class="event-text">{message.text}</span>
            </div></li>
          ))}
        </ol>
      ))}
      {loaded.state === "there" && loaded.value.length > 0 && <p class="muted">`ecatctl diagnosis {slave.position} --esi FILE` has the texts of the manufacturer.</p>}
    </Section>
  );
}
