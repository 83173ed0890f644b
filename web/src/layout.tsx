// The three columns, and the lines between them that can be moved.
import type { ComponentChildren } from "preact";
import { useState } from "preact/hooks";

const KEY = "ecatd-layout";
const LEAST = 180;
const STEP = 16;

interface Sizes {
  left: number;
  right: number;
  leftClosed: boolean;
  rightClosed: boolean;
}

function kept(): Sizes {
  const most = (part: number, size: number) => Math.min(size, Math.round(innerWidth * part));
  const usual: Sizes = { left: most(0.22, 290), right: most(0.3, 390), leftClosed: false, rightClosed: false };
  try {
    return { ...usual, ...(JSON.parse(localStorage.getItem(KEY) ?? "{}") as Partial<Sizes>) };
  } catch {
    return usual;
  }
}

export function Columns(props: { left: ComponentChildren; middle: ComponentChildren; right: ComponentChildren }) {
  const [sizes, setSizes] = useState(kept);
  const change = (part: Partial<Sizes>) =>
    setSizes((before) => {
      const next = { ...before, ...part };
      localStorage.setItem(KEY, JSON.stringify(next));
      return next;
    });
  const columns = `${sizes.leftClosed ? 0 : sizes.left}px 9px minmax(0, 1fr) 9px ${sizes.rightClosed ? 0 : sizes.right}px`;
  return (
    <main class={`columns ${sizes.leftClosed ? "left-closed" : ""} ${sizes.rightClosed ? "right-closed" : ""}`} style={{ "--columns": columns }}>
      <section class="pane left" id="topology" tabIndex={-1} aria-label="Topology">{props.left}</section>
      <Splitter name="topology" size={sizes.left} sign={1} closed={sizes.leftClosed} resize={(left) => change({ left, leftClosed: false })} close={(leftClosed) => change({ leftClosed })} />
      <div class="pane middle">{props.middle}</div>
      <Splitter name="panel" size={sizes.right} sign={-1} closed={sizes.rightClosed} resize={(right) => change({ right, rightClosed: false })} close={(rightClosed) => change({ rightClosed })} />
      <section class="pane right" id="panel" tabIndex={-1} aria-label="Panel">{props.right}</section>
    </main>
  );
}

function Splitter(props: { name: string; size: number; sign: 1 | -1; closed: boolean; resize(size: number): void; close(closed: boolean): void }) {
  const { name, size, sign, closed, resize, close } = props;
  const most = () => Math.max(LEAST, innerWidth / 2);
  const set = (wanted: number) => (wanted < LEAST / 2 ? close(true) : resize(Math.min(most(), Math.max(LEAST, Math.round(wanted)))));
  return (
    <div
      class={`splitter ${name}`} role="separator" aria-orientation="vertical" tabIndex={0} aria-label={`Width of the ${name}`}
      aria-valuenow={closed ? 0 : size} aria-valuemin={0} aria-valuemax={1000} title="Drag to resize; double-click to hide or show"
      onDblClick={() => close(!closed)}
      onKeyDown={(event) => {
        const step = { ArrowRight: STEP, ArrowLeft: -STEP }[event.key];
        if (step !== undefined) set((closed ? 0 : size) + sign * step);
        else if (event.key === "Enter") close(!closed);
      }}
      onPointerDown={(down) => {
        const line = down.currentTarget;
        const start = closed ? 0 : size;
        line.setPointerCapture(down.pointerId);
        line.onpointermove = (move) => set(start + sign * (move.clientX - down.clientX));
        line.onpointerup = () => (line.onpointermove = null);
      }}
    />
  );
}
