// The page of `ecatctl web`.
import { render } from "preact";

import { Connection } from "./connection";
import { Scope, ScopeModel } from "./scope/scope";

const connection: Connection = new Connection({
  connected: () => {},
  message: (message) => {
    if (message.type === "signals") scope.setSignals(message.signals);
    else if (message.type === "events") scope.takeEvents(message.events);
    else scope.takeMessage(message);
  },
  batch: (data) => scope.takeBatch(data),
});
const scope = new ScopeModel(connection);

render(<Scope model={scope} />, document.getElementById("page")!);
void connection.open();
