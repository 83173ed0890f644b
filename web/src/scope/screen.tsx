// The canvas of the curves, and what the user does on it.
import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";

import { timeText } from "./axes";
import { Swatch, valueText } from "./legend";
import type { Palette } from "./messages";
import type { ScopeModel } from "./model";

const KEYS =
  "Keys: left and right move, plus and minus zoom, Home shows all, End or L the newest, " +
  "C cursors; with cursors, comma and full stop move A, M and slash move B by one cycle.";

function palette(element: Element): [Palette, boolean] {
  const style = getComputedStyle(element);
  const read = (name: string) => style.getPropertyValue(`--scope-${name}`).trim();
  const background = read("background") || "#ffffff";
  const canvas = new OffscreenCanvas(1, 1).getContext("2d")!;
  canvas.fillStyle = background;
  canvas.fillRect(0, 0, 1, 1);
  const [r, g, b] = canvas.getImageData(0, 0, 1, 1).data;
  return [{
    background, text: read("text") || "#1c2430", faint: read("faint") || "#5b6675",
    line: read("line") || "rgba(120,130,150,.2)", accent: read("accent") || "#0b62c4",
    error: read("error") || "#c3281c", warning: read("warning") || "#9a6200",
  }, 0.3 * r! + 0.59 * g! + 0.11 * b! < 128];
}

export function Screen({ model }: { model: ScopeModel }) {
  const frame = useRef<HTMLDivElement>(null);
  const curves = useRef<HTMLCanvasElement>(null);
  const overlay = useRef<HTMLCanvasElement>(null);
  const hint = useSignal<{ text: string } | null>(null);
  const place = useSignal<Place | null>(null);

  useEffect(() => {
    const [a, b] = [curves.current!, overlay.current!].map((each) => each.transferControlToOffscreen());
    model.order({ do: "open", curves: a!, overlay: b! }, [a!, b!]);
    const element = frame.current!;
    const size = () =>
      model.order({
        do: "size", width: element.clientWidth, height: element.clientHeight, ratio: devicePixelRatio,
      });
    const observer = new ResizeObserver(size);
    observer.observe(element);
    const theme = () => model.setPalette(...palette(element));
    const attributes = new MutationObserver(theme);
    attributes.observe(document.documentElement, { attributes: true });
    const scheme = matchMedia("(prefers-color-scheme: dark)");
    scheme.addEventListener("change", theme);
    const wheel = (event: WheelEvent) => turn(event);
    element.addEventListener("wheel", wheel, { passive: false });
    theme();
    size();
    return () => {
      observer.disconnect();
      attributes.disconnect();
      scheme.removeEventListener("change", theme);
      element.removeEventListener("wheel", wheel);
    };
  }, []);

  /** Part of the window at a place of the pointer: 0 left, 1 right. */
  const part = (event: MouseEvent) => {
    const { left = 0, width = 1 } = model.status.value ?? {};
    return (event.clientX - frame.current!.getBoundingClientRect().left - left) / width;
  };
  const lane = (event: MouseEvent) => {
    const y = event.clientY - frame.current!.getBoundingClientRect().top;
    const x = event.clientX - frame.current!.getBoundingClientRect().left;
    const lanes = model.status.value?.lanes.filter((each) => !each.digital && y >= each.top && y <= each.top + each.height) ?? [];
    return { y, lane: lanes.findLast((each) => x < each.left) ?? lanes[0] };
  };

  const turn = (event: WheelEvent) => {
    event.preventDefault();
    const factor = 1.0015 ** event.deltaY;
    const at = part(event);
    if (event.ctrlKey || at < 0) {
      const { y, lane: hit } = lane(event);
      if (!hit) return;
      const value = hit.high - ((y - hit.top) / hit.height) * (hit.high - hit.low);
      model.limit(hit.axis, [value + (hit.low - value) * factor, value + (hit.high - value) * factor]);
    } else if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
      model.order({ do: "pan", part: (event.deltaX || event.deltaY) / 1000 });
    } else model.order({ do: "zoom", factor, at });
  };

  const pointers = useRef(new Map<number, MouseEvent>());
  const dragged = useRef(-1); // cursor
  const down = (event: PointerEvent) => {
    frame.current!.setPointerCapture(event.pointerId);
    pointers.current.set(event.pointerId, event);
    const { view, width = 1 } = model.status.value ?? {};
    if (!view) return;
    const at = part(event);
    dragged.current = model.cursors.value.findIndex(
      (time) => Math.abs((time - view.start) / view.span - at) * width < 7,
    );
  };
  const move = (event: PointerEvent) => {
    const { view, width = 1 } = model.status.value ?? {};
    const before = pointers.current.get(event.pointerId);
    if (!view) return;
    const time = view.start + part(event) * view.span;
    if (!before) {
      const { clientX, clientY } = event;
      const box = frame.current!.getBoundingClientRect();
      const at = part(event);
      place.value = { x: clientX - box.left, y: clientY - box.top, width: box.width, height: box.height };
      point(at < 0 || at > 1 || event.pointerType === "touch" ? null : time);
      const near = model.marks.value.filter((mark) => (Math.abs(mark.time - time) / view.span) * width < 5);
      hint.value = near.length > 0
        ? { text: near.slice(-3).map((mark) => `${timeText(mark.time, 1)} ${mark.text}`).join("\n") } : null;
      return;
    }
    if (dragged.current >= 0) {
      model.setCursors(model.cursors.value.map((old, i) => (i === dragged.current ? time : old)));
      return;
    }
    if (pointers.current.size === 2) {
      const other = [...pointers.current].find(([id]) => id !== event.pointerId)![1];
      const distance = (a: MouseEvent) => Math.max(20, Math.abs(a.clientX - other.clientX));
      model.order({ do: "zoom", factor: distance(before) / distance(event), at: part(other) });
    } else model.order({ do: "pan", part: (before.clientX - event.clientX) / width });
    pointers.current.set(event.pointerId, event);
  };
  /** Points at a time, for the values there. */
  const point = (time: number | null) => model.order({ do: "hover", time });
  const up = (event: PointerEvent) => {
    pointers.current.delete(event.pointerId);
    dragged.current = -1;
  };

  const key = (event: KeyboardEvent) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const status = model.status.value;
    const step = (cursor: number, cycles: number) => model.order({ do: "step", cursor, cycles });
    const actions: Record<string, () => void> = {
      ArrowLeft: () => model.order({ do: "pan", part: -0.1 }),
      ArrowRight: () => model.order({ do: "pan", part: 0.1 }),
      PageUp: () => model.order({ do: "pan", part: -0.9 }),
      PageDown: () => model.order({ do: "pan", part: 0.9 }),
      "+": () => model.order({ do: "zoom", factor: 0.7, at: status?.view.live ? 1 : 0.5 }),
      "-": () => model.order({ do: "zoom", factor: 1 / 0.7, at: status?.view.live ? 1 : 0.5 }),
      Home: () => model.order({ do: "all" }),
      End: () => model.goLive(),
      l: () => model.goLive(),
      c: () => toggleCursors(model),
      ",": () => step(0, -1),
      ".": () => step(0, 1),
      m: () => step(1, -1),
      "/": () => step(1, 1),
    };
    const action = actions[event.key] ?? actions[event.key.toLowerCase()];
    if (!action) return;
    event.preventDefault();
    action();
  };

  const drop = (event: DragEvent) => {
    event.preventDefault();
    const data = event.dataTransfer?.getData("text/x-ecatd-signal") ?? "";
    for (const name of data.split("\n").filter(Boolean)) model.add(name);
  };

  const names = model.curves.value.map(({ label }) => label).join(", ");
  return (
    <div
      ref={frame} class="scope-screen" tabIndex={0} role="application" aria-label={`Curves. ${KEYS}`}
      onKeyDown={key} onPointerDown={down} onPointerMove={move} onPointerUp={up} onPointerCancel={up}
      onPointerLeave={() => {
        hint.value = place.value = null;
        point(null);
      }}
      onDblClick={(event: MouseEvent) => {
        const { lane: hit } = lane(event);
        if (part(event) < 0 && hit) model.limit(hit.axis, null);
      }}
      onDragOver={(event: DragEvent) => event.preventDefault()} onDrop={drop}
    >
      <canvas ref={curves} role="img" aria-label={names ? `Curves of ${names}; the table of signals has their values.` : "No signal is chosen."} />
      <canvas ref={overlay} aria-hidden="true" />
      {names === "" && (
        <p class="scope-empty">Search for a signal above, or drag one here.</p>
      )}
      {hint.value && <p class="scope-hint" role="tooltip">{hint.value.text}</p>}
      {place.value && <ReadOut model={model} at={place.value} />}
    </div>
  );
}

/** Width of a read-out, which stays within the curves. */
const WIDEST = 290;

interface Place {
  x: number;
  y: number;
  width: number;
  height: number;
}

/** What the signals have under the pointer. */
function ReadOut({ model, at }: { model: ScopeModel; at: Place }) {
  const hover = model.status.value?.hover;
  if (!hover) return null;
  // Those of the lane under the pointer.
  const names = model.status.value!.lanes
    .filter(({ top, height }) => at.y >= top - 4 && at.y <= top + height + 4).flatMap((lane) => lane.names);
  const shown = model.curves.value.map((curve, i) => ({ curve, reading: hover.readings[i] }))
    .filter(({ curve, reading }) => names.includes(curve.name) && reading);
  const rows = Math.max(1, Math.floor(at.height / 20) - 4);
  const isLeft = at.x < at.width / 2;
  const style = {
    ...(at.y < at.height / 2 ? { top: `${at.y + 12}px` } : { bottom: `${at.height - at.y + 12}px` }),
    [isLeft ? "left" : "right"]: `${Math.max(0, Math.min(at.width - WIDEST, (isLeft ? at.x : at.width - at.x) + 14))}px`,
  };
  return (
    <div class="scope-read-out" role="tooltip" style={style}>
      <small>{timeText(hover.time, 0.1)} · cycle {hover.cycle}</small>
      <table><tbody>
        {shown.slice(0, rows).map(({ curve, reading }) => (
          <tr key={curve.name}>
            <th scope="row"><Swatch curve={curve} /> <span class="scope-label"><bdi>{curve.label}</bdi></span></th>
            <td class={reading!.old ? "scope-old" : undefined}>{valueText(reading!)} <small>{curve.unit}</small></td>
          </tr>
        ))}
      </tbody></table>
      {shown.length > rows && <small>and {shown.length - rows} more</small>}
    </div>
  );
}

export function toggleCursors(model: ScopeModel): void {
  const view = model.status.value?.view;
  if (!view) return;
  model.setCursors(
    model.cursors.value.length > 0 ? [] : [view.start + view.span / 3, view.start + (2 * view.span) / 3],
  );
}
