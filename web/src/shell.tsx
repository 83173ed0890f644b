// The page: top line, topology, scope, panel.
import { useEffect, useRef } from "preact/hooks";

import { Tabs } from "./controls";
import { DrivePanel } from "./drive/drive";
import { Events } from "./events";
import { LogIn } from "./login";
import { Lamps } from "./lamps";
import { Columns } from "./layout";
import { OutputsPanel } from "./outputs";
import { Scope } from "./scope/scope";
import { SlavePanel } from "./slave/slave";
import { type State, type Tab, TABS, type Theme } from "./state";
import { clock, lasting } from "./text";
import { Timing } from "./timing";
import { Topology } from "./topology/topology";

const TITLES: Record<Tab, string> = { slave: "Slave", drive: "Drive", outputs: "Outputs", timing: "Timing", events: "Events" };
const NEXT: Record<Theme, Theme> = { auto: "light", light: "dark", dark: "auto" };
const KEYS: [string, string][] = [
  ["1 – 5", "Slave, Drive, Outputs, Timing, Events"],
  ["/", "find a slave"],
  ["↑ ↓", "along the wire, in the topology"],
  ["←", "back to where a branch begins"],
  ["Enter", "open the slave in the panel"],
  ["← → + −", "on the curves: move, zoom"],
  ["Home End C", "on the curves: all, the newest, cursors"],
  ["t", "light, dark, or as the system"],
  ["?", "this list"],
  ["Esc", "close it"],
];

export function Page({ state }: { state: State }) {
  useEffect(() => {
    const onKey = (event: KeyboardEvent) => {
      if (event.defaultPrevented) return;
      const target = event.target as HTMLElement;
      const types = ["INPUT", "TEXTAREA", "SELECT"].includes(target.tagName);
      if (event.key === "Escape") {
        state.help.value = false;
        if (types) focusOn(target.closest("[tabindex]"));
      }
      if (types || event.ctrlKey || event.metaKey || event.altKey) return;
      const tab = TABS[Number(event.key) - 1];
      if (tab !== undefined) state.tab.value = tab;
      else if (event.key === "?") state.help.value = !state.help.value;
      else if (event.key === "t") state.theme.value = NEXT[state.theme.value];
      else if (event.key === "/") document.getElementById("find-slave")?.focus();
      else return;
      event.preventDefault();
    };
    addEventListener("keydown", onKey);
    return () => removeEventListener("keydown", onKey);
  }, []);
  useEffect(keepFocus, []);
  if (state.connected.value === "refused") return state.login.value.by === "password" ? <LogIn state={state} /> : <Refused />;
  return (
    <div class={state.fresh.value || state.hello.value.title === "" ? "page" : "page stale"}>
      <Top state={state} />
      <Columns
        left={<Topology state={state} />}
        middle={<Scope model={state.scope} />}
        right={<Panel state={state} />}
      />
      {state.help.value && <Help state={state} />}
    </div>
  );
}

/** Puts the focus there, or else on the curves: it is never lost. */
function focusOn(place: HTMLElement | null | undefined): void {
  (place ?? document.querySelector<HTMLElement>(".scope-screen"))?.focus();
}

/** Where what had the focus is taken away, that around it gets it. */
function keepFocus() {
  let path: HTMLElement[] = [];
  const remember = (event: FocusEvent) => (path = event.composedPath() as HTMLElement[]);
  addEventListener("focusin", remember);
  const watch = new MutationObserver(() => {
    if (document.activeElement === document.body && path[0]?.isConnected === false) {
      focusOn(path.find((place) => place.isConnected && place.hasAttribute?.("tabindex")));
    }
  });
  watch.observe(document.body, { childList: true, subtree: true });
  return () => {
    removeEventListener("focusin", remember);
    watch.disconnect();
  };
}

function Top({ state }: { state: State }) {
  const { title, version, may, source, user, buses } = state.hello.value;
  const info = state.of("ro/info").value.value;
  const cycle = state.bus.value?.cycle_time_us;
  const about = [info?.host, info?.interface, cycle === undefined ? "" : `cycle ${cycle / 1000} ms`, version === "" ? "" : `ecatd ${version}`];
  return (
    <header class="top">
      <div class="title-line">
        <h1 class={buses.length > 1 ? "sr" : ""}>{title || "ecatd"}</h1>
        {buses.length > 1 && (
          <select aria-label="Bus" value={title} onChange={(event) => (location.search = `?bus=${encodeURIComponent(event.currentTarget.value)}`)}>
            {[...new Set([title, ...buses])].sort().map((bus) => <option key={bus}>{bus}</option>)}
          </select>
        )}
        <span class="about">{about.filter((text) => text !== undefined && text !== "").join(" · ")}</span>
        <Way state={state} />
        {source === "bus" && title !== "" && <span class="tag">{may.length === 0 ? "read only" : `may write: ${may.join(", ")}`}</span>}
        {user !== "" && <span class="tag">{user}</span>}
        {user !== "" && <button type="button" class="quiet nowrap" onClick={() => void state.connection.logOut()}>Log out</button>}
        <button type="button" class="quiet" onClick={() => (state.theme.value = NEXT[state.theme.value])} title="Light, dark, or as the system (t)">{state.theme.value}</button>
        <button type="button" class="quiet" aria-expanded={state.help.value} onClick={() => (state.help.value = !state.help.value)} title="Keys (?)" aria-label="Help">?</button>
      </div>
      <Lamps state={state} />
    </header>
  );
}

/** The way to the daemon: while it is down, all values are old. */
function Way({ state }: { state: State }) {
  const now = state.now.value;
  const connected = state.connected.value;
  const link = state.link.value;
  if (connected === "opening") return <span class="way" role="status">connecting …</span>;
  if (connected !== "open") {
    return <span class="way bad" role="status">Connection to ecatctl web lost {lasting(now - state.lostAt.value)} ago, since {clock(state.lostAt.value)}. All values are old. Trying again …</span>;
  }
  if (!link.up) {
    const old = state.bus.value === null ? "Trying again …" : `All values are old, since ${clock(link.since)} (${lasting(now - link.since)}).`;
    return <span class="way bad" role="status">{link.text.replace(/\.?$/, ".")} {old}</span>;
  }
  return <span class="way" role="status">{state.hello.value.source === "file" ? link.text : "live"}</span>;
}

function Panel({ state }: { state: State }) {
  const tab = state.tab.value;
  const errors = state.events.value.filter((event) => event.severity === "error" && state.now.value - event.time_ns / 1e9 < 60).length;
  const tabs = TABS.map((item) => [item, item === "events" && errors > 0 ? `${TITLES[item]} · ${errors} new` : TITLES[item]] as const);
  return (
    <>
      <Tabs label="Panels" tabs={tabs} chosen={tab} choose={(chosen) => (state.tab.value = chosen)} />
      <div class="panel-body" role="tabpanel" aria-label={TITLES[tab]} tabIndex={0} key={tab}>
        {tab === "slave" && <SlavePanel state={state} />}
        {tab === "drive" && <DrivePanel state={state} />}
        {tab === "outputs" && <OutputsPanel state={state} />}
        {tab === "timing" && <Timing state={state} />}
        {tab === "events" && <Events state={state} />}
      </div>
    </>
  );
}

function Help({ state }: { state: State }) {
  const close = useRef<HTMLButtonElement>(null);
  useEffect(() => {
    const before = document.activeElement as HTMLElement | null;
    close.current!.focus();
    return () => before?.focus();
  }, []);
  return (
    <dialog open class="help" aria-label="Keys">
      <h2>Keys</h2>
      <dl class="keys">{KEYS.map(([key, what]) => <div key={key}><dt><kbd>{key}</kbd></dt><dd>{what}</dd></div>)}</dl>
      <p class="muted">Drag a value, or press +, to draw it in the scope. The address of this page holds what is chosen: share it.</p>
      <button type="button" class="do" ref={close} onClick={() => (state.help.value = false)}>Close</button>
    </dialog>
  );
}

function Refused() {
  return (
    <main class="refused">
      <h1>This page needs its address</h1>
      <p><code>ecatctl web</code> prints an address that ends in <code>#token=…</code>. Open that one. It works for this browser until <code>ecatctl web</code> ends.</p>
      <p class="muted">This keeps other programs and users of this machine away from the bus.</p>
    </main>
  );
}
