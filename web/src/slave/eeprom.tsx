// The EEPROM of a slave (SII), in hexadecimal.
import { useState } from "preact/hooks";

import { save, Section, Trouble } from "../controls";
import type { Slave } from "../maps";
import type { State } from "../state";
import { hex } from "../text";
import { bytesOf } from "./coe";

const PART = 256; // words
const SIZE_WORD = 0x3e; // the size in KiBit, less one (ETG.2010)

export function Memory({ state, slave }: { state: State; slave: Slave }) {
  const [bytes, setBytes] = useState<Uint8Array | null>(null);
  const [progress, setProgress] = useState<string | null>(null);
  const [error, setError] = useState<unknown>(null);
  const part = async (word: number, count: number) =>
    bytesOf(((await state.connection.ask(`ro/sii/${slave.position}`, { word, count })) as { data: string }).data);
  const read = async () => {
    setError(null);
    try {
      const head = await part(0, 0x40);
      const size = ((head[2 * SIZE_WORD]! | (head[2 * SIZE_WORD + 1]! << 8)) + 1) * 128;
      const wanted = Math.min(size, 0x10000);
      const all = new Uint8Array(wanted);
      for (let word = 0; word < wanted / 2; word += PART) {
        setProgress(`${Math.round((200 * word) / wanted)} %`);
        all.set(await part(word, Math.min(PART, wanted / 2 - word)), 2 * word);
      }
      setBytes(all);
    } catch (failure) {
      setError(failure);
    }
    setProgress(null);
  };
  const keep = () => save(bytes!, `${state.hello.value.title}-${slave.position}-${slave.name || "slave"}.sii.bin`);
  return (
    <Section title="EEPROM" aside={bytes !== null ? `${bytes.length} bytes` : undefined}>
      <div class="toolbar">
        <button type="button" class="do" disabled={progress !== null} onClick={() => void read()}>{progress ?? (bytes === null ? "Read it" : "Read it again")}</button>
        {bytes !== null && <button type="button" class="quiet" onClick={keep}>Save</button>}
      </div>
      {error !== null && <Trouble error={error} />}
      {bytes !== null && <pre class="dump" tabIndex={0} aria-label="Content of the EEPROM">{dump(bytes)}</pre>}
    </Section>
  );
}

/** 8 bytes a line, with their text; runs of equal lines are shortened. */
function dump(bytes: Uint8Array): string {
  const lines: string[] = [];
  let before = "";
  for (let at = 0; at < bytes.length; at += 8) {
    const row = [...bytes.subarray(at, at + 8)];
    const text = row.map((byte) => byte.toString(16).padStart(2, "0")).join(" ");
    if (text === before) {
      if (lines.at(-1) !== "*") lines.push("*");
      continue;
    }
    before = text;
    const read = row.map((byte) => (byte >= 32 && byte < 127 ? String.fromCharCode(byte) : "·")).join("");
    lines.push(`${hex(at, 4).slice(2)}  ${text.padEnd(23)}  ${read}`);
  }
  return lines.join("\n");
}
