// What the user must know of the data: age, losses, limits.
import { counted } from "../text";
import type { ScopeModel } from "./model";

export function StatusLine({ model }: { model: ScopeModel }) {
  const status = model.status.value;
  const link = model.link.value;
  const history = model.history.value;
  const isFile = model.source.value === "file";
  const warnings = [];
  if (link && !link.up) warnings.push(`Old values: ${link.text}`);
  if (status?.missing) warnings.push(`Missing: ${counted(status.missing, "cycle")}.`);
  if (status?.minmax) {
    warnings.push("The page was too slow, so parts show the least and greatest values of several cycles. No peak is lost.");
  }
  if (status?.short) warnings.push("The memory for samples is full, so the oldest ones went.");
  if (status?.shift) warnings.push(`The clock was set back; newer times are shown ${(status.shift / 1000).toFixed(3)} s later.`);
  if (history?.why) warnings.push(`Signals begin now: ${history.why}`);
  if (model.notice.value) warnings.push(model.notice.value);
  const minutes = status && status.rows > 1 ? Math.round((status.last - status.first) / 1000) : 0;
  const time = `${Math.floor(minutes / 60)}:${String(minutes % 60).padStart(2, "0")}`;
  return (
    <div class="scope-status" data-ordered={model.ordered.value} data-view={status ? JSON.stringify(status) : undefined}>
      <span>
        {model.entries.value.length === 0 ? "No signal is chosen" : isFile ? (model.ended.value ? `The whole file: ${time}` : "The file is being read …") : `Recorded ${time} of 10:00 min`}
        {status && status.rows > 0 ? `, ${status.rows} cycles` : ""}
        {history && !isFile ? `; new signals begin ${history.seconds.toFixed(1)} s back` : ""}
        {status?.pauses ? `; ${counted(status.pauses, "pause")} without a recording` : ""}
      </span>
      <span role="status" class="scope-warning">{warnings.join(" ")}</span>
    </div>
  );
}
