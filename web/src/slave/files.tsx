// Files of a slave (FoE): read one by its name, or write one.
import { useEffect, useRef, useState } from "preact/hooks";

import { Section, Trouble, save } from "../controls";
import type { Slave } from "../maps";
import type { State } from "../state";
import { counted, grouped } from "../text";
import { FILE_MAX, FileTransfer, type Progress } from "./foe";

const STEPS: Record<string, string> = {
  receiving: "The file goes to the daemon",
  "to boot": "The slave goes to BOOT",
  "from boot": "The slave comes back from BOOT",
  fetching: "The file comes from the daemon",
};

/** How far it is: `120.5 of 482.0 kB, 25 %, 61.3 kB/s`. */
function words({ step, moved, size, busy, seconds }: Progress): string {
  const first = STEPS[step];
  if (step === "to boot" || step === "from boot") return `${first} …`;
  const kilobytes = (count: number) => (count / 1000).toFixed(1);
  const parts = [size === null ? `${kilobytes(moved)} kB` : `${kilobytes(moved)} of ${kilobytes(size)} kB`];
  if (size) parts.push(`${Math.round((100 * moved) / size)} %`);
  if (first === undefined && seconds > 0.5) parts.push(`${kilobytes(moved / seconds)} kB/s`);
  if (busy !== "") parts.push(`the slave is busy (${busy})`);
  return `${first === undefined ? "" : `${first}: `}${parts.join(", ")}`;
}

export function Files({ state, slave }: { state: State; slave: Slave }) {
  const [file, setFile] = useState("");
  const [password, setPassword] = useState("");
  const [boot, setBoot] = useState(false);
  const [wrong, setWrong] = useState<unknown>(null);
  const chooser = useRef<HTMLInputElement>(null);
  const transfer = state.transfers.value.get(slave.position);
  const underWay = transfer?.isUnderWay ?? false;
  if (!state.may("foe")) {
    return (
      <Section title="Files">
        <p class="empty">Files may be secrets of the maker of the slave, so also reading them needs the right <code>foe</code>: start <code>ecatctl web</code> with <code>--allow foe</code>.</p>
      </Section>
    );
  }
  const label = `slave ${slave.position} ${state.slaveName(slave.position)}`;
  const bootText = "Before, the daemon brings it to BOOT, where it exchanges no process data, and afterwards back.";
  const start = (data: Uint8Array | null, name: string) => {
    const number = password.trim() === "" ? 0 : Number(password);
    if (!Number.isInteger(number) || number < 0 || number > 0xffffffff) {
      setWrong(new Error("A password of a file is a number of 32 bits, such as 1234 or 0x12345678."));
      return;
    }
    if (data !== null && !confirm(`Write ${counted(data.length, "byte")} to ${label}, as file '${name}'? ${boot ? bootText : ""} Once the daemon has the whole file, it goes on without this page.`)) return;
    if (data === null && boot && !confirm(`Read file '${name}' of ${label}? ${bootText}`)) return;
    setWrong(null);
    const made = new FileTransfer(state.connection, slave.position, { file: name, password: number, boot }, data);
    state.transfers.value = new Map(state.transfers.value).set(slave.position, made);
  };
  const write = async (chosen: File) => {
    if (chosen.size > FILE_MAX) {
      setWrong(new Error(`'${chosen.name}' has ${grouped(chosen.size)} bytes; FoE of ecatd takes at most ${grouped(FILE_MAX)}.`));
      return;
    }
    try {
      start(new Uint8Array(await chosen.arrayBuffer()), file || chosen.name);
    } catch (error) {
      setWrong(error);
    }
  };
  return (
    <Section title="Files" aside="FoE">
      {!slave.foe && <p class="note">Its EEPROM does not say that it has files. Some slaves have them all the same.</p>}
      <form class="form" onSubmit={(event) => { event.preventDefault(); start(null, file); }}>
        <label>Name in the slave<input value={file} maxLength={255} placeholder="as its manual says" onInput={(event) => setFile(event.currentTarget.value)} /></label>
        <label>Password<input value={password} inputMode="text" placeholder="none" autocomplete="off" onInput={(event) => setPassword(event.currentTarget.value)} /></label>
        <label class="check"><input type="checkbox" checked={boot} onChange={(event) => setBoot(event.currentTarget.checked)} />in BOOT (--boot), as most slaves need for firmware</label>
        <p class="actions">
          <button type="submit" class="do" disabled={underWay || file === ""}>Read</button>
          <button type="button" disabled={underWay} onClick={() => chooser.current!.click()}>Write a file …</button>
          <input
            ref={chooser} type="file" hidden aria-label="File to write"
            onChange={(event) => {
              const [chosen] = event.currentTarget.files ?? [];
              if (chosen !== undefined) void write(chosen);
              event.currentTarget.value = ""; // so that the same file can be chosen again
            }}
          />
        </p>
      </form>
      {wrong !== null && <Trouble error={wrong} />}
      {transfer !== undefined && <Shown state={state} slave={slave} transfer={transfer} />}
    </Section>
  );
}

function Shown({ state, slave, transfer }: { state: State; slave: Slave; transfer: FileTransfer }) {
  const { request, data } = transfer;
  const progress = transfer.progress.value;
  const content = transfer.content.value;
  const error = transfer.error.value;
  const keep = () => save(content!, request.file.split(/[\\/]/).at(-1) || "file");
  // As soon as it is there, unless it was there before.
  const wasThere = useRef(content);
  useEffect(() => {
    if (content !== null && wasThere.current !== content) keep();
    wasThere.current = content;
  }, [content]);
  if (progress !== null) {
    const title = `${data === null ? "Reading" : "Writing"} ${request.file}`;
    const abort = () => {
      const half = `Stop in the middle of '${request.file}'? With half of its firmware, ${state.slaveName(slave.position)} may not work at all.`;
      if (data === null || progress.step === "receiving" || confirm(half)) void transfer.cancel();
    };
    return (
      <div class="note transfer">
        <p><strong>{title}</strong></p>
        <progress aria-label={title} value={progress.size === null ? undefined : progress.moved} max={progress.size || 1} />
        <p class="muted">{words(progress)}</p>
        <p class="actions"><button type="button" onClick={abort}>Abort</button></p>
      </div>
    );
  }
  return (
    <>
      {error !== null && <Trouble error={error} />}
      {transfer.moved.value !== null && (
        <p class={transfer.note.value === "" ? "note" : "note warning"} role="status">
          {counted(transfer.moved.value, "byte")} {data === null ? "read from" : "written to"} <strong>{request.file}</strong>.
          {transfer.note.value !== "" && ` But ${transfer.note.value}`}
          {content !== null && <> <button type="button" class="link" onClick={keep}>Save it again</button></>}
        </p>
      )}
    </>
  );
}
