// What has happened, the newest first.
import { useState } from "preact/hooks";

import { Mark } from "./lamps";
import type { BusEvent } from "./protocol";
import type { State } from "./state";
import { clock, counted } from "./text";

const SEVERITIES = ["error", "warning", "notice", "info"] as const;
const AT_ONCE = 200;

function slaveOf(event: BusEvent): number | null {
  const one = event["slave"] ?? (event["slaves"] as number[] | undefined)?.[0] ?? (event["missing"] as number[] | undefined)?.[0];
  return typeof one === "number" ? one : null;
}

/** What has happened in an incident, in words. */
function FirstReading({ state }: { state: State }) {
  const { value, failure } = state.of("reading").value;
  if ((value === null && failure === null) || state.hidesReading.value) return null;
  return (
    <section class="note reading" aria-label="First reading">
      <h3>First reading<button type="button" class="quiet" onClick={() => (state.hidesReading.value = true)}>Hide</button></h3>
      {value === null ? <p>{failure?.message}</p> : <p class="reading-text">{value.text.trim()}</p>}
    </section>
  );
}

export function Events({ state }: { state: State }) {
  const [least, setLeast] = useState<(typeof SEVERITIES)[number]>("info");
  const [search, setSearch] = useState("");
  const [most, setMost] = useState(AT_ONCE);
  const wanted = search.toLowerCase();
  const found = state.events.value.filter(
    (event) =>
      SEVERITIES.indexOf(event.severity) <= SEVERITIES.indexOf(least) &&
      (wanted === "" || `${event.text} ${event.event}`.toLowerCase().includes(wanted)),
  );
  return (
    <div class="events">
      <FirstReading state={state} />
      <div class="toolbar">
        <input type="search" placeholder="Search events" aria-label="Search events" value={search} onInput={(e) => setSearch(e.currentTarget.value)} />
        <select aria-label="Least severity" value={least} onChange={(e) => setLeast(e.currentTarget.value as typeof least)}>
          <option value="info">all</option>
          <option value="notice">notices and worse</option>
          <option value="warning">warnings and errors</option>
          <option value="error">errors</option>
        </select>
      </div>
      {found.length === 0 && <p class="empty">{state.events.value.length === 0 ? "Nothing has happened yet." : "No event is like this."}</p>}
      <ol class="event-list">
        {found.slice(0, most).map((event) => {
          const slave = slaveOf(event);
          const seconds = event.time_ns / 1e9;
          const text = (
            <>
              <span class="event-when">
                {(event.severity === "error" || event.severity === "warning") && <Mark state={event.severity === "error" ? "bad" : "warning"} />}
                <time dateTime={new Date(seconds * 1000).toISOString()}>{clock(seconds, true)}</time>
                <span class="muted">{state.ago(seconds)}</span>
                {typeof event["times"] === "number" && event["times"] > 1 && <span class="muted">{event["times"]} times</span>}
              </span>
              <span class="event-text">{event.text}</span>
            </>
          );
          return (
            <li key={`${String(event["instance"])}/${event.sequence}`} class={`event ${event.severity}`}>
              <span class="sr">{event.severity}: </span>
              <button type="button" class="event-body" title={slave === null ? "Show it in the scope" : `Open slave ${slave}, and show it in the scope`} onClick={() => {
                if (slave !== null) state.open(slave);
                state.scope.show(seconds * 1000);
              }}>{text}</button>
            </li>
          );
        })}
      </ol>
      {found.length > most && <button type="button" class="more" onClick={() => setMost(most + AT_ONCE)}>Show more of {counted(found.length, "event")}</button>}
      {state.leftOut.value > 0 && <p class="muted pad">{counted(state.leftOut.value, "older event")} are no longer kept.</p>}
    </div>
  );
}
