"""Formats the shared memory of a bus as tables of 80 columns."""

from __future__ import annotations

import textwrap
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import groupby, zip_longest
from typing import Any

from ecatd.linux.process_state import WORDS
from ecatd.shm.contract import COUNTERS

from .output import WIDTH, date_text, fitting, shortened, table_lines
from .stats_screen import duration
from .terminal import alarm, heading

_REASONS = {
    "start": "never claimed",
    "released": "released",
    "lapsed": "lease lost",
    "died": "owner died",
    "gone": "slot taken",
    "stopping": "daemon stops",
    "wkc": "working counter",
}

Document = dict[str, Any]


def contents_lines(document: Document) -> list[str]:
    """Formats the whole shared memory, from a document of `contents.contents`."""
    return [
        *_head(document),
        *_section(_domains(document["domains"])),
        *_section(_slaves(document["slaves"])),
        *_section(_signals(document)),
        *_section(_slots(document["slots"])),
        *_section(_settings(document["settings"])),
        *_section(_health(document["health"])),
        *_problems(document),
    ]


def claims_lines(document: Document) -> list[str]:
    """Formats clients and outputs, from an answer `Outputs` with names."""
    return [
        _title(document),
        *_section(_slots(document["owners"]) or ["no client has outputs or sends requests"]),
        *_section(_outputs(document) or ["no outputs"]),
        *_problems(document),
    ]


def age(us: float | None) -> str:
    """Formats an age in µs: `12 µs`, `1.2 ms`, `3.4 s`, `0:05:12`; `-` for None."""
    if us is None:
        return "-"
    if us < 1000:
        return f"{us:.0f} µs"
    if us < 1e6:
        return f"{us / 1000:.{1 if us < 1e5 else 0}f} ms"
    return f"{us / 1e6:.1f} s" if us < 6e7 else duration(us / 1e6)


# --- parts --------------------------------------------------------------------------------------


def _title(document: Document) -> str:
    cycle = f"cycle {document['cycle']}, ended {age(document['age_us'])} ago"
    text = f"bus {document['bus']}: {document['state']}, {cycle}"
    if not document.get("alive", True):
        return alarm(f"bus {document['bus']}: NO DAEMON, only its leftovers; {cycle}")
    return heading(text)


def _head(document: Document) -> list[str]:
    lease = f"{document['lease_us'] / 1000:g} to {document['lease_max_us'] / 1000:g} ms"
    started = date_text(document["started"] % 2**40)
    return [
        _title(document),
        f"ecatd {document['version']}, pid {document['pid']}, started {started}",
        f"{document['file']}: {document['bytes']} bytes, layout {document['layout']}",
        f"every {document['cycle_time_us']:g} µs, leases of {lease}, "
        f"fingerprint {document['fingerprint']}",
    ]


def _section(lines: list[str]) -> list[str]:
    """Puts a blank line before a table, and highlights its first line; nothing if it is empty."""
    return ["", heading(lines[0]), *lines[1:]] if lines else []


def _domains(rows: list[Document]) -> list[str]:
    def table(room: int) -> list[str]:
        return table_lines(
            ("DOMAIN", "EVERY", "CYCLE", "AGE", "WKC", "STATE", "OUT", "IN"),
            (
                (
                    shortened(f"{row['number']} {row['name']}", room),
                    f"{row['divider']}+{row['phase']}" if row["phase"] else row["divider"],
                    "-" if row["cycle"] is None else row["cycle"],
                    age(row["age_us"]),
                    f"{row['wkc']}/{row['wkc_expected']}",
                    row["wkc_state"],
                    f"{row['output_bytes']} B",
                    f"{row['input_bytes']} B",
                )
                for row in rows
            ),
            " >>>> >>",
        )

    return fitting(table)


def _slaves(rows: list[Document]) -> list[str]:
    def table(room: int) -> list[str]:
        return table_lines(
            ("POS", "STATE", "NAME", "VENDOR", "PRODUCT", "DOMAIN", "OUT", "IN"),
            (
                (
                    row["position"],
                    row["state"],
                    shortened(row["name"] or "(no name)", room),
                    f"{row['vendor']:08X}",
                    f"{row['product']:08X}",
                    row["domain"],
                    f"{row['output_bytes']} B",
                    f"{row['input_bytes']} B",
                )
                for row in rows
            ),
            ">    >>>",
        )

    return fitting(table)


def _signals(document: Document) -> list[str]:
    rows = document["signals"]
    head = ("SIGNAL", "RAW", "VALUE", "VALIDITY", "OWNER")

    def table(room: int) -> list[str]:
        cells = (
            (
                f"  {'out' if row['output'] else 'in '} {row['address']} {_name(row, room)}",
                _number(row["raw"]),
                _physical(row["raw"], row["value"], row["unit"]),
                row["validity"].replace("not_operational", "not in OP"),
                _owner(row) if row["output"] else "",
            )
            for row in rows
        )
        return _grouped(head, rows, cells, document, " >>")

    return fitting(table)


def _owner(row: Document) -> str:
    return "nobody" if row["owner"] is None else f"slot {row['owner']}"


def _slots(rows: list[Document]) -> list[str]:
    if not rows:
        return []
    head = ("SLOT", "PID", "PROGRAM", "SINCE", "HEARTBEAT", "LEASE", "OWNS", "STATE")
    title, *lines = fitting(
        lambda room: table_lines(head, (_slot(row, room) for row in rows), ">>  >>>")
    )
    made = [title]
    for row, line in zip(rows, lines, strict=True):
        made += [line, *(f"      {note}" for note in _notes(row))]
    return made


def _slot(row: Document, room: int) -> tuple[Any, ...]:
    since = "?"
    if row["since"] is not None:
        seconds = max(0.0, time.time() - row["since"])
        days = int(seconds // 86400)
        when = time.strftime("%Y-%m-%d" if days else "%H:%M:%S", time.localtime(row["since"]))
        since = f"{when} ({f'{days} d' if days else duration(seconds)})"
    return (
        row["slot"],
        "?" if row["pid"] is None else row["pid"],
        shortened(row["name"] or "?", room),
        since,
        age(row["silent_ms"] * 1000),
        age(row["lease_ms"] * 1000),
        row["outputs"],
        row["state"],
    )


def _notes(row: Document) -> Iterator[str]:
    """Yields notes about a client, most about problems."""
    if row["pid_is_ours"] is False:
        yield "is in another PID namespace, such as that of a container, and has this PID there"
    if row["state"] == "lapsed":
        yield f"has lost its outputs: {_REASONS.get(row['reason'], row['reason'])}"
    if row["held"] is False:
        yield "the process is gone"
    elif row["process"] in ("stopped", "traced", "dumps") or (
        row["state"] == "lapsed" and row["process"] in WORDS
    ):
        yield f"the process {WORDS[row['process']]}"
    if row["refused"]:
        yield f"{row['refused']} values out of their range were refused"


def _folded(rows: list[Document]) -> Iterator[Document]:
    """Joins all outputs of a slave into one row if all are 0, safe, and for the same reason.

    The row has the key `alike`: the number of outputs.
    """
    for _position, group in groupby(rows, lambda row: row["slave"]):
        outputs = list(group)
        first = outputs[0]
        reasons = {(row["owner"], row["state"], row["cause"], row["value"]) for row in outputs}
        if len(outputs) > 1 and reasons == {(-1, "safe", first["cause"], 0)}:
            yield first | {"alike": len(outputs), "unit": "", "physical": 0}
        else:
            yield from outputs


def _outputs(document: Document) -> list[str]:
    rows, names, owners = document["outputs"], _slave_names(document), document["owners"]
    if len(names) > 1:
        rows = list(_folded(rows))
    head = ("OUTPUT", "VALUE", "STATE", "OWNER OR WHY NONE", "SINCE")
    now = time.time()

    def decided(row: Document) -> str:
        if row["owner"] >= 0:
            owner = owners[row["owner"]]
            return f"slot {owner['slot']} {shortened(owner['name'] or '?', 12)}"
        if row["state"] == "copied" and row["cause"] in ("start", "source"):
            source = row["source"] or "an input that does not exist"
            return f"from {source}{', not valid' * (row['cause'] == 'source')}"
        if row["state"] == "can":
            return "ecatd: frames of a CAN bus"
        return str(_REASONS.get(row["cause"], row["cause"]))

    def table(room: int) -> list[str]:
        cells = (
            (
                f"{shortened(names[row['slave']], room + 8)}: {row['alike']} outputs, each"
                if "alike" in row
                else f"  {row['address']} {shortened(row['label'], room)}",
                _physical(row["value"], row["physical"], row["unit"]) or _number(row["value"]),
                row["state"],
                decided(row),
                "" if row["since"] is None else age(max(0.0, now - row["since"]) * 1e6),
            )
            for row in rows
        )
        return _grouped(head, rows, cells, document, " >  >")

    return fitting(table)


def _grouped(
    head: tuple[str, ...],
    rows: list[Document],
    cells: Iterable[tuple[Any, ...]],
    document: Document,
    right: str,
) -> list[str]:
    """Makes a table of entries; a line with the name of the slave precedes its entries."""
    if not rows:
        return []
    names = _slave_names(document)
    title, *lines = table_lines(head, cells, right)
    made = [title]
    for position, group in groupby(zip(rows, lines, strict=True), lambda pair: pair[0]["slave"]):
        entries = list(group)
        if "alike" not in entries[0][0]:  # such a row contains the name of the slave
            made.append(shortened(names[position], WIDTH))
        made += [line for _row, line in entries]
    return made


def _slave_names(document: Document) -> dict[int, str]:
    """Names of slaves by position, with a default for wrong positions in damaged memory."""
    names = defaultdict[int, str](lambda: "(no such slave)")
    for slave in document["slaves"]:
        names[slave["position"]] = f"{slave['position']} {slave['name'] or '(no name)'}"
    return names


def _name(row: Document, room: int) -> str:
    return shortened(row["name"] or row["pdo_name"], room)


def _number(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _physical(raw: float | None, value: float | None, unit: str) -> str:
    """Formats the physical value with its unit; empty if it is just the raw value."""
    return "" if value is None or (value == raw and not unit) else f"{value:.6g} {unit}".rstrip()


def _settings(rows: list[Document]) -> list[str]:
    cells = []
    for row in rows:
        result = "granted" if row["granted"] else "REFUSED" if row["wanted"] else "not asked for"
        value = f" ({row['value']})" if row["granted"] and row["value"] else ""
        cells.append(f"{row['setting'].replace('_', ' '):<15}{result}{value}")
    return ["REAL TIME", *_columns(cells, 2)] if cells else []


def _health(row: Document | None) -> list[str]:
    if row is None:
        return []
    cells = [f"{item.label:<14}{row[item.name]:>10}" for item in COUNTERS if item.unit != "ns"]
    for name in ("slaves_found", "ring", "dc"):
        cells.append(f"{name.replace('_', ' '):<14}{row[name]:>10}")
    return ["EXCHANGE", *_columns(cells, 3)]


def _columns(cells: list[str], count: int) -> list[str]:
    """Arranges cells in columns, which are filled one after the other."""
    rows = -(-len(cells) // count)
    columns = [cells[at : at + rows] for at in range(0, len(cells), rows)]
    return [
        "  ".join(cell.ljust(WIDTH // count - 2) for cell in row).rstrip()
        for row in zip_longest(*columns, fillvalue="")
    ]


def _problems(document: Document) -> list[str]:
    problems, made = document["problems"], []
    if problems:
        made = ["", alarm("DAMAGED: THIS MAKES NO SENSE")]
        for problem in problems[:20]:
            made += [alarm(line) for line in textwrap.wrap(problem, WIDTH - 1)]
        if len(problems) > 20:
            made.append(alarm(f"… and {len(problems) - 20} more (--json has all)"))
    alive = document.get("alive", True)
    if not alive:
        file = document["file"]
        made += [
            "",
            "No daemon runs on this bus. The next start of ecatd replaces these leftovers;",
            f"to remove it now: rm -f {file} {file}.out",
        ]
    elif problems:
        made.append("Restart the daemon: it makes the shared memory anew.")
    return made
