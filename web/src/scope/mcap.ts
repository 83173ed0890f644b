// A minimal writer of MCAP (mcap.dev/spec): one channel, JSON, chunks without compression.

const CHUNK = 1 << 20;
const TEXT = new TextEncoder();
const MAGIC = [0x89, 0x4d, 0x43, 0x41, 0x50, 0x30, 0x0d, 0x0a];
const LIBRARY = "ecatctl web";

enum Op {
  Header = 1, Footer, Schema, Channel, Message, Chunk, MessageIndex, ChunkIndex,
  Statistics = 0x0b, SummaryOffset = 0x0e, DataEnd,
}

/** Bytes that are put one behind the other, little endian. */
class Bytes {
  #data = new Uint8Array(1024);
  #view = new DataView(this.#data.buffer);
  length = 0;

  /** Makes room, in new `data` and `view` if need be; returns where it begins. */
  #room(size: number): number {
    if (this.length + size > this.#data.length) {
      const data = new Uint8Array(Math.max(this.#data.length * 2, this.length + size));
      data.set(this.#data);
      this.#data = data;
      this.#view = new DataView(data.buffer);
    }
    this.length += size;
    return this.length - size;
  }

  u8(value: number): this {
    const at = this.#room(1);
    this.#view.setUint8(at, value);
    return this;
  }

  u16(value: number): this {
    const at = this.#room(2);
    this.#view.setUint16(at, value, true);
    return this;
  }

  u32(value: number): this {
    const at = this.#room(4);
    this.#view.setUint32(at, value, true);
    return this;
  }

  u64(value: number | bigint): this {
    const at = this.#room(8);
    this.#view.setBigUint64(at, BigInt(value), true);
    return this;
  }

  bytes(value: Uint8Array): this {
    const at = this.#room(value.length);
    this.#data.set(value, at);
    return this;
  }

  text(value: string): this {
    const bytes = TEXT.encode(value);
    return this.u32(bytes.length).bytes(bytes);
  }

  record(op: Op, content: Bytes): this {
    return this.u8(op).u64(content.length).bytes(content.get());
  }

  get(): Uint8Array<ArrayBuffer> {
    return this.#data.slice(0, this.length);
  }
}

export class Mcap {
  readonly #parts: Uint8Array<ArrayBuffer>[] = [];
  private offset = 0;
  private chunk = new Bytes();
  private index = new Bytes();
  readonly #indexes = new Bytes();
  readonly #head = new Bytes();
  #chunks = 0;
  #count = 0;
  #chunkFrom = 0n;
  private from = 0n;
  #to = 0n;

  constructor(topic: string, schemaName: string, schema: object) {
    const data = TEXT.encode(JSON.stringify(schema));
    this.#head
      .record(Op.Schema, new Bytes().u16(1).text(schemaName).text("jsonschema").u32(data.length).bytes(data))
      .record(Op.Channel, new Bytes().u16(0).u16(1).text(topic).text("json").u32(0));
    this.#put(new Bytes().bytes(Uint8Array.from(MAGIC)).record(Op.Header, new Bytes().text("").text(LIBRARY)));
    this.chunk.bytes(this.#head.get());
  }

  #put(bytes: Bytes): void {
    this.#parts.push(bytes.get());
    this.offset += bytes.length;
  }

  /** Adds a message in JSON; `time` in ns. */
  add(time: bigint, sequence: number, message: string): void {
    if (this.index.length === 0) this.#chunkFrom = time;
    if (this.#count++ === 0) this.from = time;
    this.#to = time;
    this.index.u64(time).u64(this.chunk.length);
    const data = TEXT.encode(message);
    this.chunk.record(Op.Message, new Bytes().u16(0).u32(sequence >>> 0).u64(time).u64(time).bytes(data));
    if (this.chunk.length >= CHUNK) this.#endChunk();
  }

  #endChunk(): void {
    if (this.index.length === 0) return;
    const { chunk, index, offset } = this;
    const record = new Bytes().record(
      Op.Chunk,
      new Bytes().u64(this.#chunkFrom).u64(this.#to).u64(chunk.length).u32(0).text("")
        .u64(chunk.length).bytes(chunk.get()),
    );
    const messages = new Bytes().record(
      Op.MessageIndex, new Bytes().u16(0).u32(index.length).bytes(index.get()),
    );
    this.#indexes.record(
      Op.ChunkIndex,
      new Bytes().u64(this.#chunkFrom).u64(this.#to).u64(offset).u64(record.length)
        .u32(10).u16(0).u64(offset + record.length)
        .u64(messages.length).text("").u64(chunk.length).u64(chunk.length),
    );
    this.#put(record);
    this.#put(messages);
    this.#chunks++;
    this.chunk = new Bytes();
    this.index = new Bytes();
  }

  end(): Blob {
    this.#endChunk();
    this.#put(new Bytes().record(Op.DataEnd, new Bytes().u32(0)));
    const start = this.offset;
    this.#put(this.#head);
    const indexes = this.offset;
    this.#put(this.#indexes);
    const statistics = this.offset;
    this.#put(new Bytes().record(
      Op.Statistics,
      new Bytes().u64(this.#count).u16(1).u32(1).u32(0).u32(0).u32(this.#chunks)
        .u64(this.from).u64(this.#to).u32(10).u16(0).u64(this.#count),
    ));
    const offsets = this.offset;
    this.#put(new Bytes()
      .record(Op.SummaryOffset, new Bytes().u8(Op.ChunkIndex).u64(indexes).u64(statistics - indexes))
      .record(Op.SummaryOffset, new Bytes().u8(Op.Statistics).u64(statistics).u64(offsets - statistics))
      .record(Op.Footer, new Bytes().u64(start).u64(offsets).u32(0))
      .bytes(Uint8Array.from(MAGIC)));
    return new Blob(this.#parts, { type: "application/octet-stream" });
  }
}
