"""The application: puts what the feed says into lamps, tables and lists."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Iterator
from typing import Any, ClassVar

from rich.text import Text
from textual import on, work
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.message import Message
from textual.screen import ModalScreen
from textual.widgets import DataTable, Footer, Input, Static, TabbedContent, TabPane

from ecatd.base.errors import EcatError
from ecatd.base.sanitized_output import printable
from ecatd.description.bus import Bus
from ecatd.operations.health import row_label
from ecatd.view.lamps import Lamps, owner_name

from .feed import Feed, Look, Lost, Opened, Row, Told
from .lamp_line import LampLine
from .objects import Objects
from .signals import Signals

_EVENTS = 500
"""Events that are kept."""
_TABS = ("slaves", "signals", "events", "outputs", "buses")
_PANEL_TABS = {"topology": "slaves", "timing": "signals", "outputs": "outputs", "events": "events"}
_SEVERE = {"error": "bold red", "warning": "yellow", "notice": "", "info": "dim"}

_HELP = """\
1 … 5      slaves, signals, events, outputs, buses
← →        the tab beside (in the line of tabs)
↑ ↓        move; Page Up, Page Down, Home, End too
Enter      slaves: objects of the slave
           buses: show this bus
l  L       the next lamp, the lamp before; v shows why
/          filter by name; Esc ends it
t          colours for a dark or a light terminal
q          quit

Marks: ● good   ▲ warning   ■ bad   ? unknown
The mouse works too: click lamps, tabs, rows.

Esc closes this help."""


class Help(ModalScreen[None]):
    """Keys and marks."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape,q,question_mark", "dismiss", "Close")]

    def compose(self) -> ComposeResult:
        """The text."""
        yield Static(_HELP, id="box", markup=False)


class Top(App[None]):
    """`ecatctl top`.

    Args:
        bus: Name of the bus.
        connect: Zenoh endpoint, or None for this machine.
        timeout: Seconds to wait for an answer.

    Attributes:
        failure: Why it has ended, if the user has not ended it.
    """

    class Came(Message):
        """Something came from the feed."""

        def __init__(self, feed: Feed, told: Told) -> None:
            super().__init__()
            self.feed = feed
            self.told = told

    ENABLE_COMMAND_PALETTE = False
    CSS = """
    #head { height: 1; }
    LampLine { height: auto; max-height: 5; min-height: 2; }
    #filter { height: 1; border: none; padding: 0; display: none; }
    #message { height: auto; max-height: 4; }
    TabbedContent { height: 1fr; }
    TabPane { padding: 0; }
    DataTable { height: 1fr; scrollbar-size-vertical: 1; scrollbar-size-horizontal: 0; }
    Signals { height: 1fr; scrollbar-size-vertical: 1; }
    Footer { height: 1; }
    ModalScreen { align: center middle; }
    #box { width: auto; max-width: 78; height: auto; border: round ansi_blue; padding: 0 1; }
    Ask #box { width: 72; }
    Ask Input { border: none; height: 1; margin: 1 0; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("question_mark", "help", "Help", key_display="?"),
        Binding("slash", "filter", "Filter", key_display="/"),
        Binding("l", "lamp(1)", "Lamp"),
        Binding("L", "lamp(-1)", "Lamp before", show=False),
        Binding("v", "evidence", "Why"),
        Binding("t", "colours", "Colours"),
        Binding("q", "quit", "Quit"),
        Binding("escape", "leave_filter", show=False),
        *(
            Binding(str(number), f"tab('{name}')", show=False)
            for number, name in enumerate(_TABS, 1)
        ),
    ]

    def __init__(self, bus: str, connect: str | None, timeout: float) -> None:
        super().__init__(ansi_color=True)
        self.failure: EcatError | None = None
        self.theme = "ansi-dark"
        self._bus_name = bus
        self._connect = connect
        self._timeout = timeout
        self._lamps = Lamps()
        self._bus: Bus | None = None
        self._look: Look | None = None
        self._lost = ""
        self._events: deque[dict[str, Any]] = deque(maxlen=_EVENTS)
        self._filter = ""
        self._labels: dict[tuple[int, str], str] = {}  # names of entries for people
        self._opened: Opened | None = None
        self.feed: Feed

    def compose(self) -> ComposeResult:
        """Head, lamps, tabs, keys."""
        yield Static(id="head")
        yield LampLine()
        yield Input(placeholder="only what has this in its name", id="filter")
        with TabbedContent(initial="slaves"):
            with TabPane("1 Slaves", id="slaves"):
                yield DataTable(id="slave-table", cursor_type="row")
            with TabPane("2 Signals", id="signals"):
                yield Signals()
            with TabPane("3 Events", id="events"):
                yield DataTable(id="event-table", cursor_type="row")
            with TabPane("4 Outputs", id="outputs"):
                yield DataTable(id="output-table", cursor_type="row")
            with TabPane("5 Buses", id="buses"):
                yield DataTable(id="bus-table", cursor_type="row")
        yield Footer(show_command_palette=False)

    def on_mount(self) -> None:
        """Columns, and the first questions."""
        heads = {
            "slave": (("#", 3), ("SLAVE", 22), ("STATE", 26), ("WHAT IS WRONG", None)),
            "event": (("TIME", 8), ("KIND", 16), ("WHAT", None)),
            "output": (("OUTPUT", 28), ("VALUE", 10), ("OWNER", 20), ("SINCE", 8), ("WHY", None)),
            "bus": (("BUS", 30), ("", None)),
        }
        for name, columns in heads.items():
            table = self.query_one(f"#{name}-table", DataTable)
            for title, width in columns:
                table.add_column(title, width=width, key=title)
        self.query_one("#slave-table").focus()
        self.set_interval(1.0, self._tick)
        self.set_interval(5.0, self._find_buses)
        self._begin(self._bus_name)

    def on_unmount(self) -> None:
        """Ends the threads."""
        self.feed.close()

    def _begin(self, bus: str) -> None:
        self._bus_name = bus
        self._lamps = Lamps()
        self._look, self._bus, self._lost = None, None, ""
        self._events.clear()
        self.query_one(LampLine).show(())
        for table in self.query(DataTable):
            if table.id != "bus-table":
                table.clear()
        feed = Feed(
            bus,
            self._connect,
            self._timeout,
            lambda told: self.post_message(self.Came(feed, told)),
        )
        self.feed = feed
        self._tick()
        self._find_buses()

    # --- what comes -------------------------------------------------------------------------------

    @on(Came)
    def _came(self, message: Came) -> None:
        if message.feed is not self.feed:
            return  # of a bus that was shown before
        if not self.screen_stack or not self.screen_stack[0].query(Signals):
            return  # the end has begun, and the screen is gone
        told = message.told
        if isinstance(told, Row):
            self._main(Signals).add(told.values)
        elif isinstance(told, Opened):
            self._opened = told
            self._begin_signals()
        elif isinstance(told, Lost):
            self._lost = told.text
            self._judge()
        else:
            self._take(told)
        self._tick()

    def _main(self, kind: Any) -> Any:
        """A widget of the main screen, also while another one is in front of it."""
        return self.screen_stack[0].query_one(kind)

    def _table(self, name: str) -> DataTable[Any]:
        found: DataTable[Any] = self._main(f"#{name}-table")
        return found

    def _take(self, look: Look) -> None:
        is_other = self._bus is None or look.begins
        self._look, self._bus, self._lost = look, look.bus, ""
        if look.begins:
            self._events.clear()
            self._table("event").clear()
        self._judge()
        if is_other:
            self._labels = dict(_labels(look.bus))
            self._begin_signals()
        self._draw_slaves()
        self._draw_outputs()
        for event in look.events:
            self._events.append(event)
        if look.events:
            self._draw_events()

    def _begin_signals(self) -> None:
        if self._opened is not None and self._bus is not None:
            self._main(Signals).begin(self._opened.signals, self._labels, self._opened.why_not)

    def _judge(self) -> None:
        look = self._look
        maps = (None, None, None)
        if look is not None and not self._lost:
            maps = look.statistics, look.states, look.outputs
        self._main(LampLine).show(self._lamps.look(*maps, time.time()))

    def _tick(self) -> None:
        if not self.screen_stack:
            return
        line = Text(no_wrap=True, overflow="ellipsis")
        line.append(f"ecatd {self._bus_name}", "bold")
        if self._bus is not None:
            line.append(f"  {self._bus.cycle_time_us:g} µs  {len(self._bus.slaves)} slaves")
        if self._connect:
            line.append(f"  at {self._connect}", "dim")
        if self._lost:
            old = f", values are of {_clock(self._look.at)}" if self._look else ""
            line.append(f"  ■ NO CONNECTION{old}: {self._lost}", "bold red")
        elif self._look is None:
            line.append("  connecting…", "dim")
        else:
            line.append(f"  {_clock(time.time())}", "dim")
        self._main("#head").update(line)

    def _draw_slaves(self) -> None:
        assert self._look is not None
        states = self._look.states
        if states is None:
            return
        rows = []
        for row in states["slaves"]:
            name = row_label(row).partition("(")[2].removesuffix(")")
            if not self._fits(f"{row['position']} {name}"):
                continue
            fine = row["al_state"] == 8 and not row["recovery"]
            style = "green" if fine else "dim" if row["recovery"] == "absent" else "bold red"
            wrong = ", ".join(filter(None, (row["recovery"], row["recovery_text"])))
            since = f"since {_clock(row['since'])}" if row["since"] else ""
            mark = "●" if fine else "?" if row["recovery"] == "absent" else "■"
            rows.append(
                (
                    str(row["position"]),
                    Text(str(row["position"]), justify="right"),
                    Text(printable(name)),
                    Text(f"{mark} {row['text']}", style),
                    Text(printable(", ".join(filter(None, (wrong, since)))), style),
                )
            )
        _fill(self._table("slave"), rows)

    def _draw_outputs(self) -> None:
        assert self._look is not None
        found = self._look.outputs
        if found is None:
            return
        rows = []
        for output in found["outputs"]:
            name = self._labels.get((output["slave"], output["address"]), output["name"])
            owner = owner_name(found["owners"][output["owner"]]) if output["owner"] >= 0 else ""
            if output["state"] == "copied":
                owner = f"copy of {output['source']}"
            if not self._fits(f"{name} {owner}"):
                continue
            value = output["value"] if output.get("physical") is None else output["physical"]
            shown = "–" if value is None else f"{value:.7g} {output.get('unit', '')}"
            style = "" if output["owner"] >= 0 else "dim"
            rows.append(
                (
                    output["name"],
                    Text(printable(name), style),
                    Text(shown.strip(), style, justify="right"),
                    Text(printable(owner or output["state"]), style),
                    Text(_clock(output["since"]) if output["since"] else "", "dim"),
                    Text(printable(output["reason"]), style),
                )
            )
        _fill(self._table("output"), rows)

    def _draw_events(self) -> None:
        table = self._table("event")
        at_top = table.cursor_row <= 0
        table.clear()
        for event in reversed(self._events):
            what = self._what(event)
            if not self._fits(f"{event['event']} {what}"):
                continue
            style = _SEVERE.get(event["severity"], "")
            moment = time.strftime("%H:%M:%S", time.localtime(event["time_ns"] / 1e9))
            table.add_row(
                Text(moment, "dim"), Text(event["event"], style), Text(printable(what), style)
            )
        if at_top and table.row_count:
            table.move_cursor(row=0)

    def _what(self, event: dict[str, Any]) -> str:
        position, text = event.get("slave", -1), str(event.get("text", ""))
        slaves = self._bus.slaves if self._bus else []
        label = slaves[position].label if 0 <= position < len(slaves) else ""
        times = f" ({event['times']} times)" if event.get("times", 1) > 1 else ""
        return (text if label in text else f"{label}: {text}") + times

    def _fits(self, text: str) -> bool:
        return self._filter in text.casefold()

    # --- buses ------------------------------------------------------------------------------------

    @work(thread=True, exclusive=True, group="buses")
    def _find_buses(self) -> None:
        try:
            found = self.feed.buses()
        except (EcatError, OSError):
            return
        self.call_from_thread(self._show_buses, found)

    def _show_buses(self, found: list[str]) -> None:
        rows = [
            (
                bus,
                Text(bus),
                Text("shown now" if bus == self._bus_name else "Enter shows it", "dim"),
            )
            for bus in found
        ]
        _fill(self._table("bus"), rows)

    @on(DataTable.RowSelected, "#bus-table")
    def _choose_bus(self, event: DataTable.RowSelected) -> None:
        bus = event.row_key.value
        if bus and bus != self._bus_name:
            self.feed.close()
            self._begin(bus)
            self.action_tab("slaves")

    @on(DataTable.RowSelected, "#slave-table")
    def _choose_slave(self, event: DataTable.RowSelected) -> None:
        if self._bus is not None and event.row_key.value is not None:
            self.push_screen(Objects(self.feed, self._bus.slaves[int(event.row_key.value)]))

    # --- keys -------------------------------------------------------------------------------------

    def action_tab(self, name: str) -> None:
        """Shows a tab, and lets the keys move in it."""
        if len(self.screen_stack) > 1:
            return
        self.query_one(TabbedContent).active = name
        pane = self.query_one(f"#{name}", TabPane)
        pane.query("DataTable, Signals").first().focus()

    def action_help(self) -> None:
        """Shows the keys."""
        if not isinstance(self.screen, ModalScreen):
            self.push_screen(Help())

    def action_colours(self) -> None:
        """Changes between dark and light."""
        self.theme = "ansi-light" if self.theme == "ansi-dark" else "ansi-dark"

    def action_lamp(self, by: int) -> None:
        """Chooses another lamp."""
        self._main(LampLine).step(by)

    def action_evidence(self) -> None:
        """Shows what the chosen lamp is about."""
        if (lamp := self._main(LampLine).lamp) is not None:
            self._show_evidence(LampLine.Chosen(lamp))

    @on(LampLine.Chosen)
    def _show_evidence(self, message: LampLine.Chosen) -> None:
        evidence = message.lamp["evidence"]
        self.action_tab(_PANEL_TABS[evidence["panel"]])
        table = self._table("slave")
        if evidence["slave"] is not None and (key := str(evidence["slave"])) in table.rows:
            table.move_cursor(row=table.get_row_index(key))

    def action_filter(self) -> None:
        """Opens the line for the filter."""
        field = self._main("#filter")
        field.display = True
        field.focus()

    def action_leave_filter(self) -> None:
        """Shows all again."""
        field = self._main("#filter")
        if field.display:
            field.value = ""
            field.display = False
            self.action_tab(self.query_one(TabbedContent).active)

    @on(Input.Changed, "#filter")
    def _filter_changed(self, event: Input.Changed) -> None:
        self._filter = event.value.casefold()
        self._main(Signals).filter(event.value)
        if self._look is not None:
            self._draw_slaves()
            self._draw_outputs()
            self._draw_events()

    @on(Input.Submitted, "#filter")
    def _filter_done(self, event: Input.Submitted) -> None:
        if self._opened is not None and not self._opened.signals:
            self.feed.choose(event.value)
        self.action_tab(self.query_one(TabbedContent).active)


def _labels(bus: Bus) -> Iterator[tuple[tuple[int, str], str]]:
    """Names of entries for people, by slave and address: `4 Value`.

    Where a slave has several entries of a name, that of their PDO is before it.
    """
    for slave in bus.slaves:
        found = [*slave.entries(outputs=True), *slave.entries(outputs=False)]
        uses = Counter(entry.name for _, entry, _ in found)
        for pdo, entry, _ in found:
            address = f"0x{entry.index:04X}:{entry.subindex:02X}"
            name = entry.name or address
            if uses[entry.name] > 1 and pdo.name and pdo.name != name:
                name = f"{pdo.name} / {name}"
            yield (slave.position, address), printable(f"{slave.position} {name}")


def _clock(moment: float) -> str:
    return time.strftime("%H:%M:%S", time.localtime(moment))


def _fill(table: DataTable[Any], rows: list[tuple[Any, ...]]) -> None:
    """Brings a table up to date; the cursor stays where it is if the same rows are there.

    Args:
        table: The table.
        rows: The key of each row, and its cells.
    """
    columns = [*table.columns]
    if [key.value for key in table.rows] == [row[0] for row in rows]:
        for key, *cells in rows:
            for column, cell in zip(columns, cells, strict=True):
                if table.get_cell(key, column) != cell:
                    table.update_cell(key, column, cell, update_width=True)
        return
    at = table.cursor_row
    table.clear()
    for key, *cells in rows:
        table.add_row(*cells, key=key)
    if 0 <= at < table.row_count:
        table.move_cursor(row=at)
