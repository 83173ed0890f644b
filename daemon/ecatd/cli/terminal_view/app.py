"""The application: puts what the feed says into lamps and lists."""

from __future__ import annotations

import asyncio
import os
import signal
import threading
import time
import traceback
from collections import Counter, deque
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from rich.text import Text
from textual import on
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.events import Event, Key, MouseDown
from textual.message import Message
from textual.screen import ModalScreen
from textual.widgets import Footer, Input, Static, TabbedContent, TabPane

from ecatd.base.daemon_threads import in_daemon_thread
from ecatd.base.errors import EcatError
from ecatd.base.sanitized_output import printable
from ecatd.description.bus import Bus, Slave
from ecatd.etg.scaling import to_physical
from ecatd.operations.health import row_label
from ecatd.view.lamps import Lamps, owner_name

from .ask import Ask
from .by_hand import ByHand
from .driver import LenientDriver
from .feed import Feed, Look, Lost, Opened, Row, Told
from .filter_line import FilterLine
from .glyphs import MARKS, STYLES
from .lamp_line import LampLine
from .lines import Column, Line, Lines
from .objects import Objects
from .signals import Meaning, Signals

_EVENTS = 500
"""Events that are kept."""
_ALONE_S = 60.0
"""Seconds without a key or a click after which outputs held by hand are released: a terminal cannot
see whether somebody is there, and a broken connection of ssh can look alive for long."""
_ENDING = (signal.SIGHUP, signal.SIGINT, signal.SIGQUIT, signal.SIGTERM)
_END_S = 5.0
"""Most seconds from a signal to the end."""
_TABS = ("slaves", "signals", "events", "outputs", "owners", "buses")
_PANEL_TABS = {"topology": "slaves", "timing": "signals", "outputs": "outputs", "events": "events"}
_SEVERE = {"error": "bold red", "warning": "yellow", "notice": "", "info": "dim"}
_STATE_OF_CABLE = {"bad": "bad", "strained": "warning"}

_HELP = f"""\
1 … 6      slaves, signals, events, outputs, owners, buses
← →        the tab beside
↑ ↓        move; Page Up, Page Down, Home, End too
Enter      slaves: objects of the slave
           buses: show this bus
e          outputs: drive one by hand; x releases all
l  L       the next lamp, the lamp before; v shows why
/          filter by name; Esc ends it
t          colours for a dark or a light terminal
q          quit

Marks: {"   ".join(f"{mark} {state}" for state, mark in MARKS.items())}
The mouse works too: click lamps, tabs and lines; a click on
the line under the cursor opens it.

Esc closes this help."""


class SlaveLines(Lines):
    """The slaves."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("enter", "choose", "Objects")]


class OutputLines(Lines):
    """The outputs."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("e,enter", "choose", "By hand…", key_display="e"),
        Binding("x", "app.release", "Release"),
    ]


class BusLines(Lines):
    """The buses."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("enter", "choose", "Show")]


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
    """

    class Came(Message):
        """Something came from the feed."""

        def __init__(self, feed: Feed, told: Told) -> None:
            super().__init__()
            self.feed = feed
            self.told = told

    class HeldNow(Message):
        """What the user holds by hand from now on, and a sentence about it."""

        def __init__(self, by_hand: ByHand, held: Mapping[str, str], text: str) -> None:
            super().__init__()
            self.by_hand = by_hand
            self.held = held
            self.text = text

    ENABLE_COMMAND_PALETTE = False
    CSS = """
    #head, #held { height: 1; }
    #held { display: none; text-style: bold reverse; color: ansi_yellow; }
    LampLine { height: auto; max-height: 5; min-height: 2; }
    FilterLine { height: 1; display: none; padding: 0 1; }
    FilterLine Label { text-style: bold; }
    FilterLine Input { width: 1fr; height: 1; border: none; padding: 0; }
    #detail { height: auto; min-height: 2; max-height: 5; color: ansi_cyan; padding: 0 1; }
    #message { height: auto; max-height: 4; padding: 0 1; }
    TabbedContent { height: 1fr; }
    Tabs, Tabs:focus { height: 1; }
    Tabs Underline { display: none; }
    Tab { padding: 0 1; }
    Tab.-active, Tabs:focus Tab.-active { text-style: bold reverse; }
    TabPane { padding: 0; }
    Lines { height: 1fr; scrollbar-size-vertical: 1; overflow-x: hidden; }
    Footer { height: 1; }
    ModalScreen { align: center middle; }
    #box { width: auto; max-width: 76; height: auto; border: round ansi_blue; padding: 0 1; }
    Ask #box { width: 72; }
    Ask Label { width: 100%; }
    #what { text-style: bold; }
    #facts { color: ansi_cyan; }
    .sure { text-style: bold; color: ansi_yellow; }
    Ask Input { border: round ansi_cyan; height: 3; padding: 0 1; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("question_mark", "help", "Help", key_display="?"),
        # With priority, so that what is typed right after it goes into the line.
        Binding("slash", "filter", "Filter", key_display="/", priority=True),
        Binding("l", "lamp(1)", "Lamp"),
        Binding("L", "lamp(-1)", "Lamp before", show=False),
        Binding("v", "evidence", "Why"),
        Binding("t", "colours", "Colours"),
        Binding("q", "quit", "Quit"),
        Binding("escape", "leave_filter", show=False),
        Binding("left", "beside(-1)", show=False),
        Binding("right", "beside(1)", show=False),
        *(
            Binding(str(number), f"tab('{name}')", show=False)
            for number, name in enumerate(_TABS, 1)
        ),
    ]

    def __init__(self, bus: str, connect: str | None, timeout: float) -> None:
        super().__init__(driver_class=LenientDriver, ansi_color=True)
        self.theme = "ansi-dark"
        self._bus_name = bus
        self._connect = connect
        self._timeout = timeout
        self._lamps = Lamps()
        self._bus: Bus | None = None
        self._look: Look | None = None
        self._lost = ""
        self._events: deque[tuple[int, dict[str, Any]]] = deque(maxlen=_EVENTS)
        self._counted = 0  # events
        self._meanings: dict[tuple[int, str], Meaning] = {}
        self._opened: Opened | None = None
        self._held: Mapping[str, str] = {}
        self._touched = 0.0  # when the user last did something
        self._said = ""
        self._detail = ""  # what is shown below the lists
        self.feed: Feed
        self.by_hand: ByHand

    def compose(self) -> ComposeResult:
        """Head, lamps, tabs, what the line under the cursor says, keys."""
        yield Static(id="head")
        yield Static(id="held")
        yield LampLine()
        yield FilterLine()
        with TabbedContent(initial="slaves"):
            with TabPane("1 Slaves", id="slaves"):
                yield SlaveLines(
                    (
                        Column("#", 3, right=True),
                        Column("SLAVE", 24, 36),
                        Column("STATE", 14, 40),
                        Column("WHAT IS WRONG", 30),
                    ),
                    "Waiting for the slaves…",
                    id="slave-lines",
                )
            with TabPane("2 Signals", id="signals"):
                yield Signals()
            with TabPane("3 Events", id="events"):
                yield Lines(
                    (Column("TIME", 8), Column("KIND", 15, 20), Column("WHAT", 49)),
                    "Nothing has happened yet",
                    id="event-lines",
                )
            with TabPane("4 Outputs", id="outputs"):
                yield OutputLines(
                    (
                        Column("OUTPUT", 26, 46),
                        Column("VALUE", 12, 16, right=True),
                        Column("SINCE", 8),
                        Column("OWNER, OR WHY IT IS SAFE", 25),
                    ),
                    "No outputs",
                    id="output-lines",
                )
            with TabPane("5 Owners", id="owners"):
                yield Lines(
                    (
                        Column("OWNER", 32, 46),
                        Column("OUTPUTS", 7, right=True),
                        Column("LEASE", 8, right=True),
                        Column("SILENT", 8, right=True),
                        Column("SINCE", 14),
                    ),
                    "No program uses the shared memory of this bus: all outputs are safe or copied",
                    id="owner-lines",
                )
            with TabPane("6 Buses", id="buses"):
                yield BusLines((Column("BUS", 30, 46), Column("", 30)), id="bus-lines")
        yield Static(id="detail", markup=False)
        yield Footer(show_command_palette=False)

    @property
    def defect(self) -> str:
        """What has ended the screen though nobody wanted it, and where; empty if nothing did."""
        error = self._exception
        if error is None:
            return ""
        places = traceback.extract_tb(error.__traceback__)
        where = f" ({places[-1].filename}:{places[-1].lineno})" if places else ""
        return " ".join(f"{error!r}{where}".split())

    def _fatal_error(self) -> None:
        """Ends without Textual's page of traceback: `defect` says it in a line."""
        self._close_messages_no_wait()

    def on_load(self) -> None:
        """Before anything is drawn: signals end the screen as the key q does."""
        for number in _ENDING:
            asyncio.get_running_loop().add_signal_handler(number, self._end_by, number)

    def _end_by(self, number: int) -> None:
        status = 128 + number
        self.exit(return_code=status)
        # A terminal that is gone may block what writes to it. The daemon releases outputs by hand.
        last = threading.Timer(_END_S, os._exit, (status,))
        last.daemon = True
        last.start()

    def on_mount(self) -> None:
        """The first questions."""
        self.set_focus(self._list("slave"))
        self.set_interval(1.0, self._tick)
        self.set_interval(5.0, self._find_buses)
        self._begin(self._bus_name)

    def on_unmount(self) -> None:
        """Ends the threads."""
        self._end()

    def _begin(self, bus: str) -> None:
        self._bus_name = bus
        self._lamps = Lamps()
        self._look, self._bus, self._lost, self._opened = None, None, "", None
        self._events.clear()
        self._main(LampLine).show(())
        self._main(Signals).forget()
        for name in ("slave", "event", "output", "owner"):
            self._list(name).fill(())
        feed = Feed(
            bus,
            self._connect,
            self._timeout,
            lambda told: self.post_message(self.Came(feed, told)),
        )
        by_hand = ByHand(
            feed.open,
            lambda held, text: self.post_message(self.HeldNow(by_hand, held, text)),
        )
        self.feed, self.by_hand, self._held = feed, by_hand, {}
        self._tick()
        self._find_buses()

    def _end(self) -> None:
        self.feed.close()
        self.by_hand.close()

    # --- what comes -------------------------------------------------------------------------------

    @on(Came)
    def _came(self, message: Came) -> None:
        if message.feed is not self.feed:
            return  # of a bus that was shown before
        if not self._is_there:
            return
        told = message.told
        if isinstance(told, Row):
            self._main(Signals).add(told.values)
        elif isinstance(told, Opened):
            self._opened = told
            self._begin_signals()
        elif isinstance(told, Lost):
            self._lost = told.text
            self._judge()
            self._tick()
        else:
            self._take(told)
            self._tick()

    @property
    def _is_there(self) -> bool:
        """Whether the main screen is there: not when the end has begun."""
        return bool(self.screen_stack) and bool(self.screen_stack[0].query("#detail"))

    def _main(self, kind: Any) -> Any:
        """A widget of the main screen, also while another one is in front of it."""
        return self.screen_stack[0].query_one(kind)

    def _list(self, name: str) -> Lines:
        found: Lines = self._main(f"#{name}-lines")
        return found

    def _take(self, look: Look) -> None:
        is_other = self._bus is None or look.begins
        self._look, self._bus, self._lost = look, look.bus, ""
        if look.begins:
            self._events.clear()
        self._judge()
        if is_other:
            self._meanings = dict(_meanings(look.bus))
            self._begin_signals()
        for event in look.events:
            self._counted += 1
            self._events.append((self._counted, event))
        self._draw(events=bool(look.events) or look.begins)

    def _draw(self, *, events: bool = True) -> None:
        if self._look is None:
            return
        if self._look.states is not None:
            self._list("slave").fill([*self._slave_lines(self._look.states)])
        if self._look.outputs is not None:
            self._list("output").fill([*self._output_lines(self._look.outputs)])
            self._list("owner").fill([*self._owner_lines(self._look.outputs)])
        if events:
            self._list("event").fill([*self._event_lines()], newest_first=True)

    def _begin_signals(self) -> None:
        if self._opened is not None and self._bus is not None:
            self._main(Signals).begin(self._opened.signals, self._meanings, self._opened.why_not)

    def _judge(self) -> None:
        look = self._look
        maps = (None, None, None)
        if look is not None and not self._lost:
            maps = look.statistics, look.states, look.outputs
        self._main(LampLine).show(self._lamps.look(*maps, time.time()))

    def _tick(self) -> None:
        if not self._is_there:
            return
        line = Text(no_wrap=True, overflow="ellipsis")
        line.append(f"ecatd {self._bus_name}", "bold")
        if self._bus is not None:
            line.append(f"  cycle {self._bus.cycle_time_us:g} µs  {len(self._bus.slaves)} slaves")
        if self._connect:
            line.append(f"  at {self._connect}", "dim")
        if self._lost:
            old = f", values are of {_clock(self._look.at)}" if self._look else ""
            line.append(f"  {MARKS['bad']} NO CONNECTION{old}", "bold red")
        elif self._look is None:
            line.append("  connecting…", "dim")
        else:
            line.append(f"  {_clock(time.time())}", "dim")
        self._main("#head").update(line)
        self._moved()
        self._watch_hand()

    # --- lines of the lists -----------------------------------------------------------------------

    def _slave_lines(self, states: Mapping[str, Any]) -> Iterator[Line]:
        cables = {
            cable["slave"]: cable["verdict"]
            for cable in states.get("cables", ())
            if cable["verdict"] in _STATE_OF_CABLE
        }
        for row in states["slaves"]:
            name = printable(row_label(row).partition("(")[2].removesuffix(")"))
            if not self._fits(f"{row['position']} {name}"):
                continue
            state = "good"
            if row["al_state"] != 8 or row["recovery"]:
                state = "unknown" if row["recovery"] == "absent" else "bad"
            wrong = [row["recovery"], row["recovery_text"]]
            if verdict := cables.get(row["position"]):
                wrong.append(f"the cable in front of it is {verdict}: see `ecatctl errors`")
                state = _STATE_OF_CABLE[verdict] if state == "good" else state
            said = printable(", ".join(filter(None, wrong)))
            since = f"since {_clock(row['since'])}" if row["since"] else ""
            style = STYLES[state]
            yield Line(
                str(row["position"]),
                (
                    Text(str(row["position"])),
                    Text(name),
                    Text(f"{MARKS[state]} {printable(row['text'])}", style),
                    Text(", ".join(filter(None, (said, since))), style),
                ),
                f"{row['position']} {name}: {printable(row['text'])}"
                f"{f' {since}' if since else ''}{f': {said}' if said else ''}. "
                f"{self._about(row['position'])}",
            )

    def _about(self, position: int) -> str:
        """What a slave is, and what can be done with it here."""
        slaves = self._bus.slaves if self._bus else []
        if not 0 <= position < len(slaves):
            return ""
        slave = slaves[position]
        entries = [len([*slave.entries(outputs=out)]) for out in (True, False)]
        what = f"{entries[0]} outputs, {entries[1]} inputs" if any(entries) else "No process data"
        coe = "Enter shows its objects" if slave.coe else "it has no objects"
        return f"{what}; {coe}"

    def _output_lines(self, found: Mapping[str, Any]) -> Iterator[Line]:
        for output in found["outputs"]:
            meaning = self._meanings.get((output["slave"], output["address"]))
            name = meaning.label if meaning else printable(output["name"])
            owner = owner_name(found["owners"][output["owner"]]) if output["owner"] >= 0 else ""
            if output["name"] in self._held:
                owner = "you, by hand"
            if output["state"] == "copied":
                owner = f"copy of {output['source']}"
            elif output["state"] == "can":
                owner = "ecatd, for CAN frames"
            if not self._fits(f"{name} {owner}"):
                continue
            value = output["value"] if output.get("physical") is None else output["physical"]
            shown = "–" if value is None else f"{value:.7g} {output.get('unit', '')}".strip()
            named = meaning.values.get(value, "") if meaning and value is not None else ""
            style = "" if output["owner"] >= 0 else "dim"
            if output["name"] in self._held:
                style = "bold yellow"
            since = _clock(output["since"]) if output["since"] else ""
            why = printable(output["reason"])
            who = printable(owner or output["state"])
            said = f"{who}{f': {why}' if why else ''}"
            yield Line(
                output["name"],
                (
                    Text(name, style),
                    Text(printable(shown), style),
                    Text(since, "dim"),
                    Text(said, style),
                ),
                f"{name} ({output['name']}): {printable(shown)}{f' ({named})' if named else ''}; "
                f"{f'since {since} ' if since else ''}{said}",
            )

    def _owner_lines(self, found: Mapping[str, Any]) -> Iterator[Line]:
        for owner in found["owners"]:
            name = printable(owner_name(owner))
            if not self._fits(name):
                continue
            since = _clock(owner["since"]) if owner["since"] else ""
            lapsed = owner["state"] == "lapsed"
            lost = f"it has lost its outputs: {owner['reason']}" if lapsed else ""
            facts = [
                f"{name} owns {owner['outputs']} of {len(found['outputs'])} outputs",
                f"lease {owner['lease_ms']:g} ms, silent for {owner['silent_ms']:.3g} ms",
                f"{owner['lapses']} leases lost in its place since the start of the daemon",
            ]
            if owner["refused"]:
                facts.append(f"{owner['refused']} values out of their range refused")
            yield Line(
                str(owner["slot"]),
                (
                    Text(name, "bold red" if lapsed else ""),
                    Text(str(owner["outputs"])),
                    Text(f"{owner['lease_ms']:.5g} ms"),
                    Text(f"{owner['silent_ms']:.3g} ms"),
                    Text(f"{since} {lost}".strip(), "bold red" if lapsed else "dim"),
                ),
                "; ".join(filter(None, [*facts, lost])),
            )

    def _event_lines(self) -> Iterator[Line]:
        for number, event in reversed(self._events):
            what = printable(self._what(event))
            if not self._fits(f"{event['event']} {what}"):
                continue
            style = _SEVERE.get(event["severity"], "")
            clock = _clock(event["time_ns"] / 1e9)
            yield Line(
                str(number),
                (Text(clock, "dim"), Text(event["event"], style), Text(what, style)),
                f"{clock} {event['severity']} {event['event']}: {what}",
            )

    def _what(self, event: dict[str, Any]) -> str:
        position, text = event.get("slave", -1), str(event.get("text", ""))
        slaves = self._bus.slaves if self._bus else []
        label = slaves[position].label if 0 <= position < len(slaves) else ""
        times = f" ({event['times']} times)" if event.get("times", 1) > 1 else ""
        return (text if label in text else f"{label}: {text}") + times

    def _fits(self, text: str) -> bool:
        found: bool = self._main(FilterLine).text in text.casefold()
        return found

    @on(Lines.Moved)
    def _moved(self) -> None:
        if self._is_there and (active := self._main(TabbedContent).active):
            lines = self._main(f"#{active}").query_one(Lines)
            lost = f"No connection: {self._lost}" if self._lost else ""
            text = printable(self._said or lost or lines.detail)
            if text != self._detail:  # drawing it costs more than all else
                self._detail = text
                self._main("#detail").update(Text(text))

    @on(TabbedContent.TabActivated)
    def _other_tab(self) -> None:
        self._said = ""
        self._moved()

    def _say(self, text: str) -> None:
        """Says something in place of what the line under the cursor says, until the next key."""
        self._said = text
        self._moved()

    async def on_event(self, event: Event) -> None:
        """Sees each key and click before all others."""
        if isinstance(event, Key | MouseDown):
            self._touched = time.monotonic()
            self._said = ""
        await super().on_event(event)

    # --- buses ------------------------------------------------------------------------------------

    def _find_buses(self) -> None:
        self.run_worker(in_daemon_thread(self._ask_buses), group="buses", exclusive=True)

    def _ask_buses(self) -> None:
        try:
            self.feed.asking()  # so that what the user asks for later comes at once
            found = self.feed.buses()
        except (EcatError, OSError):
            return
        self.call_later(self._show_buses, found)

    def _show_buses(self, found: list[str]) -> None:
        if not self._is_there:
            return
        self._list("bus").fill(
            [
                Line(
                    bus,
                    (
                        Text(bus),
                        Text("shown now" if bus == self._bus_name else "Enter shows it", "dim"),
                    ),
                )
                for bus in found
            ]
        )

    @on(Lines.Chosen, "#bus-lines")
    def _choose_bus(self, event: Lines.Chosen) -> None:
        if event.key != self._bus_name:
            self._end()
            self._begin(event.key)
            self.action_tab("slaves")

    @on(Lines.Chosen, "#slave-lines")
    def _choose_slave(self, event: Lines.Chosen) -> None:
        if self._bus is None:
            return
        slave = self._bus.slaves[int(event.key)]
        if slave.coe:
            self.push_screen(Objects(self.feed, slave))
        else:
            self._say(f"{printable(slave.label)} has no objects: it does not support CoE.")

    # --- outputs by hand --------------------------------------------------------------------------

    @on(Lines.Chosen, "#output-lines")
    def _choose_output(self, event: Lines.Chosen) -> None:
        """Asks for a value for an output."""
        outputs = self._look.outputs if self._look else None
        if self._bus is None or outputs is None:
            return
        output = next(each for each in outputs["outputs"] if each["name"] == event.key)
        if output["owner"] >= 0 and event.key not in self._held:
            owner = owner_name(outputs["owners"][output["owner"]])
            self._say(f"{owner} owns this output. Outputs by hand never take one from its owner.")
            return
        if output["state"] == "copied":
            self._say(f"This output is a copy of {output['source']} (`[[outputs.copy]]`).")
            return
        if output["state"] == "can":
            self._say("ecatd exchanges CAN frames with it: see `ecatctl can send`.")
            return
        self._say("Asking whether you may drive outputs…")
        slave = self._bus.slaves[output["slave"]]
        ask = in_daemon_thread(lambda: self._ask_output(event.key, slave))
        self.run_worker(ask, group="outputs", exclusive=True)

    def _ask_output(self, name: str, slave: Slave) -> None:
        try:
            why_not = self.feed.asking().why_not("outputs", slave)
        except EcatError as error:
            why_not = str(error)
        self.call_later(self._open_question, name, slave, why_not)

    def _open_question(self, name: str, slave: Slave, why_not: str) -> None:
        if not self._is_there:
            return
        if why_not:
            self._say(f"You may not drive outputs by hand: {why_not}")
            return
        if len(self.screen_stack) > 1 or self.query_one(TabbedContent).active != "outputs":
            return  # the user has gone on meanwhile
        self._say("")

        def drive(value: str | None) -> None:
            if value is None:
                self._say("Nothing was changed.")
            else:
                self.by_hand.want({**self._held, name: value.strip()})

        meaning = self._meanings.get((slave.position, name.partition("/")[2]))
        named = ", ".join([*meaning.values.values()][:6]) if meaning else ""
        facts = (
            f"Of {printable(slave.label)}. A number, with its unit if it has one"
            f"{f', or {named}' if named else ''}. The output keeps it until you "
            f"press x, for {_ALONE_S:.0f} s without a key, or until top ends."
        )
        label = meaning.label if meaning else name
        ask = Ask(f"Drive {label} ({name}) by hand", facts, self._held.get(name, ""), "drive it")
        self.push_screen(ask, drive)

    @on(HeldNow)
    def _held_now(self, message: HeldNow) -> None:
        if message.by_hand is not self.by_hand or not self._is_there:
            return
        self._held = message.held
        if message.text:
            self._say(message.text)
        self._watch_hand()
        self._draw(events=False)

    def _watch_hand(self) -> None:
        """Shows what is held by hand, and ends it if nobody is there."""
        line = self._main("#held")
        line.display = bool(self._held)
        if not self._held:
            return
        left = self._touched + _ALONE_S - time.monotonic()
        if left <= 0:
            self.by_hand.want({})
        what = ", ".join(f"{name} = {value}" for name, value in self._held.items())
        line.update(
            Text(
                f" BY HAND, x releases ({max(0.0, left):.0f} s without a key, too): {what}",
                no_wrap=True,
                overflow="ellipsis",
            )
        )

    def action_release(self) -> None:
        """Releases all that is held by hand."""
        if self._held:
            self.by_hand.want({})
        else:
            self._say("You hold no outputs by hand.")

    # --- keys -------------------------------------------------------------------------------------

    def action_tab(self, name: str) -> None:
        """Shows a tab, and lets the keys move in it."""
        if len(self.screen_stack) > 1:
            return
        self.query_one(TabbedContent).active = name
        self.set_focus(self.query_one(f"#{name}", TabPane).query_one(Lines))

    def action_beside(self, by: int) -> None:
        """Shows the tab beside."""
        if len(self.screen_stack) == 1:
            at = _TABS.index(self.query_one(TabbedContent).active)
            self.action_tab(_TABS[(at + by) % len(_TABS)])

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
        if evidence["slave"] is not None:
            self._list("slave").move_to(str(evidence["slave"]))

    def action_filter(self) -> None:
        """Opens the line for the filter of this screen."""
        for line in self.screen.query(FilterLine):
            line.open()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """A / within a text is a letter."""
        del parameters
        return action != "filter" or not isinstance(self.focused, Input)

    def action_leave_filter(self) -> None:
        """Shows all again."""
        if self._main(FilterLine).end():
            self.action_tab(self.query_one(TabbedContent).active)

    @on(Input.Changed, "#filter")
    def _filter_changed(self, event: Input.Changed) -> None:
        self._main(Signals).filter(event.value)
        self._draw()

    @on(Input.Submitted, "#filter")
    def _filter_done(self, event: Input.Submitted) -> None:
        if self._opened is not None and not self._opened.signals:
            self.feed.choose(event.value)
        self.action_tab(self.query_one(TabbedContent).active)


def _meanings(bus: Bus) -> Iterator[tuple[tuple[int, str], Meaning]]:
    """What entries mean, by slave and address; their names for people are such as `4 Value`.

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
            values = {
                to_physical(value.number, entry.scale, entry.offset): printable(value.name)
                for value in entry.values
            }
            label = printable(f"{slave.position} {name}")
            yield (slave.position, address), Meaning(label, values)


def _clock(moment: float) -> str:
    return time.strftime("%H:%M:%S", time.localtime(moment))
