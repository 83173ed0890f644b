// The page of `ecatctl web`.
import { render } from "preact";

import { Connection } from "./connection";
import { ScopeModel } from "./scope/scope";
import { Page } from "./shell";
import { State } from "./state";
import { Traces } from "./traces";

const connection: Connection = new Connection({
  connected: (...change) => state.takeConnected(...change),
  message: (message) => {
    state.take(message);
    if (message.type === "signals") scope.setSignals(message);
    else if (message.type === "events") scope.takeEvents(message.events);
    else scope.takeMessage(message);
  },
  batch: (data) => {
    // The scope may give the bytes away to its worker, so it comes last.
    state.live.takeBatch(data);
    scope.takeBatch(data);
  },
});
const traces = new Traces(connection);
const scope = new ScopeModel(traces.part(true));
const state = new State(connection, traces, scope);

render(<Page state={state} />, document.getElementById("page")!);
void connection.open();
