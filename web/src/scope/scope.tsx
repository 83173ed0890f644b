// The scope: signals over time, while they are recorded.
import { Controls } from "./controls";
import { Legend } from "./legend";
import type { ScopeModel } from "./model";
import { Panels } from "./panels";
import { Screen } from "./screen";
import { StatusLine } from "./status";

export { ScopeModel } from "./model";

export function Scope({ model }: { model: ScopeModel }) {
  return (
    <section class="scope" aria-label="Scope">
      <Controls model={model} />
      <div class="scope-main">
        <Screen model={model} />
        <Legend model={model} />
      </div>
      <Panels model={model} />
      <StatusLine model={model} />
    </section>
  );
}
