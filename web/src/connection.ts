// The WebSocket to `ecatctl web`: says hello, comes back after a loss, and asks.
import type { Failure, Message, Request, Value } from "./protocol";

const PAUSE_MS = 1000;
/** Without a word for so long, the connection is taken for lost: the server says something every second. */
const SILENT_MS = 5000;

/** An error of the daemon, or of the way to it. */
export class AskError extends Error {
  constructor(readonly failure: Failure) {
    super(failure.message);
  }
}

interface Waiting {
  resolve(answer: Value): void;
  reject(error: AskError): void;
}

/** How somebody comes in: with the address that `ecatctl web` prints, or as a user with a password. */
export interface Login {
  by: "token" | "password";
  /** What to do, or why it was refused. */
  message: string;
}

export interface Listener {
  /** The connection to `ecatctl web` has come, gone at a time in ms, or needs a login. */
  connected(state: "open" | "lost" | "refused", login?: Login, heard?: number): void;
  message(message: Message): void;
  /** A batch of a trace; see `readBatch`. */
  batch(data: ArrayBuffer): void;
}

export class Connection {
  private socket: WebSocket | null = null;
  #number = 0;
  #again = 0;
  /** When the server last said something, and whether it had said nothing at the last look. */
  private heard = 0;
  private isSilent = false;
  readonly #waiting = new Map<number, Waiting>();
  #trace: { signals: string[]; history: string[]; generation: number } = {
    signals: [], history: [], generation: 0,
  };

  constructor(private readonly listener: Listener) {}

  /** Changes the token of the address into a cookie, if there is one, and connects. */
  async open(): Promise<void> {
    // Somebody may also open a new address in a page that is there already.
    addEventListener("hashchange", () => void this.#login());
    await this.#login();
    this.#connect();
    setInterval(() => this.#look(), 1000);
  }

  /** Asks a query of docs/zenoh-keys.md. Rejects with `AskError`. */
  ask(key: string, parameters: Value = {}, payload: Value = {}): Promise<Value> {
    const ask = ++this.#number;
    return new Promise((resolve, reject) => {
      this.#waiting.set(ask, { resolve, reject });
      if (!this.send({ type: "ask", ask, key, parameters, payload })) {
        this.#waiting.delete(ask);
        reject(lost());
      }
    });
  }

  /**
   * Says which signals the page wants in each cycle, and which of them begin with their last seconds;
   * returns the generation of their batches.
   */
  setTrace(signals: string[], history: string[]): number {
    this.#trace = { signals, history, generation: this.#trace.generation + 1 };
    this.send({ type: "trace", ...this.#trace });
    return this.#trace.generation;
  }

  /** Logs a user in; returns why not, or "". */
  async logIn(user: string, password: string): Promise<string> {
    const text = String.fromCharCode(...new TextEncoder().encode(`${user}:${password}`));
    const answer = await fetch("/login", { headers: { Authorization: `Basic ${btoa(text)}` } }).catch(() => null);
    if (answer === null) return "The server does not answer. Try again.";
    if (!answer.ok) return ((await answer.json()) as Login).message;
    this.#connect();
    return "";
  }

  /** Ends the login; the page forgets all that it knows. */
  async logOut(): Promise<void> {
    await fetch("/logout").catch(() => null);
    location.reload();
  }

  async #login(): Promise<void> {
    const token = new URLSearchParams(location.hash.slice(1)).get("token");
    if (token === null) return;
    history.replaceState(null, "", location.pathname + location.search);
    await fetch("/login", { headers: { Authorization: `Bearer ${token}` } }).catch(() => null);
  }

  private send(request: Request): boolean {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(request));
    return true;
  }

  #connect(): void {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    clearTimeout(this.#again);
    const bus = new URLSearchParams(location.search).get("bus");
    const which = bus === null ? "" : `?bus=${encodeURIComponent(bus)}`;
    const socket = new WebSocket(`${scheme}://${location.host}/socket${which}`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.heard = Date.now();
    socket.onopen = () => {
      this.listener.connected("open");
      if (this.#trace.signals.length > 0) this.send({ type: "trace", ...this.#trace });
    };
    socket.onmessage = ({ data }: MessageEvent<string | ArrayBuffer>) => {
      if (this.socket !== socket) return;
      this.heard = Date.now();
      if (typeof data === "string") this.#take(JSON.parse(data) as Message);
      else this.listener.batch(data);
    };
    socket.onclose = () => {
      if (this.socket === socket) void this.#lose();
    };
  }

  #take(message: Message): void {
    if (message.type === "answer" || message.type === "failure") {
      const waiting = this.#waiting.get(message.ask);
      this.#waiting.delete(message.ask);
      if (message.type === "answer") waiting?.resolve(message.answer);
      else waiting?.reject(new AskError(message.failure));
    } else {
      this.listener.message(message);
    }
  }

  /** A network that has gone, and a server that hangs, close no connection. */
  #look(): void {
    const wasSilent = this.isSilent;
    this.isSilent = this.socket !== null && Date.now() - this.heard > SILENT_MS;
    // Twice: what has come meanwhile is heard first, if the page itself was busy.
    if (!this.isSilent || !wasSilent) return;
    const { socket } = this;
    this.socket = null;
    socket?.close();
    this.listener.connected("lost", undefined, this.heard);
    void this.#lose();
  }

  async #lose(): Promise<void> {
    for (const { reject } of this.#waiting.values()) reject(lost());
    this.#waiting.clear();
    // A browser does not tell the page why a WebSocket was refused; `/login` without a token does.
    const answer = await fetch("/login", { signal: AbortSignal.timeout(SILENT_MS) }).catch(() => null);
    if (answer?.status === 401) this.listener.connected("refused", (await answer.json()) as Login);
    else this.listener.connected("lost");
    this.#again = window.setTimeout(() => this.#connect(), PAUSE_MS);
  }
}

function lost(): AskError {
  return new AskError({ name: "unreachable", message: "The connection to ecatctl web is lost." });
}
