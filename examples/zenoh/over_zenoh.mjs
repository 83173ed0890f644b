/* Reads a bus from Node: node over_zenoh.mjs ENDPOINT, such as ws/cell4:10000.
 *
 * It finds the buses in reach, reads the vendor ID of slave 0 of the first one (object 0x1018:01), and
 * prints three values as they come. ENDPOINT is that of a Zenoh router with the plugin
 * zenoh-plugin-remote-api, or of the program zenoh-bridge-remote-api.
 *
 *   npm install @eclipse-zenoh/zenoh-ts@1 @msgpack/msgpack@3
 *   node --experimental-wasm-modules over_zenoh.mjs ws/cell4:10000
 *
 * Node 22 and later have WebSocket; Node 20 needs the option --experimental-websocket, too.
 */
import { Config, RingChannel, Sample, Session } from "@eclipse-zenoh/zenoh-ts";
import { decode } from "@msgpack/msgpack";

const SHOWN = 3;

/* Each payload of ecatd is a map. */
const content = (message) => decode(message.payload().toBytes());

const hex = (bytes) => Buffer.from(bytes).toString("hex");

/* Finds the buses in reach; returns the beginning of the keys of each. */
async function find(session) {
  const buses = [];
  for await (const reply of await session.liveliness().get("ecat/v1/*/alive")) {
    const sample = reply.result();
    if (sample instanceof Sample) {
      buses.push(sample.keyexpr().toString().slice(0, -"/alive".length));
    }
  }
  return buses;
}

/* Reads an object, and prints its bytes, or why it cannot be read. */
async function readObject(session, bus, slave, index, subindex) {
  for await (const reply of await session.get(`${bus}/ro/sdo/${slave}/${index}/${subindex}`)) {
    const answer = reply.result();
    const { name, data, error } = content(answer);
    console.log(answer instanceof Sample ? `${name}: ${hex(data)}` : error.message);
  }
}

/* Prints values of the process data as they are published. */
async function watch(session, bus) {
  const subscriber = await session.declareSubscriber(`${bus}/ro/pdo/**`, { handler: new RingChannel(100) });
  let shown = 0;
  for await (const sample of subscriber.receiver()) {
    console.log(sample.keyexpr().toString().slice(bus.length), content(sample).value);
    if (++shown === SHOWN) break;
  }
  await subscriber.undeclare();
}

const session = await Session.open(new Config(process.argv[2] ?? "ws/127.0.0.1:10000"));
const buses = await find(session);
console.log("buses:", ...buses);
if (buses.length > 0) {
  await readObject(session, buses[0], 0, "0x1018", 1);
  await watch(session, buses[0]);
}
await session.close();
