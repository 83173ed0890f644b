"""The objects of a slave: to browse, to read, and to write where the user may.

The list of objects is there at once. What each is, the slave says for one entry at a time, which
can take long: this is asked in the background, first for the objects that are seen. An object with
several entries is opened to see them, and this reads their values.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, ClassVar

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.screen import Screen
from textual.widgets import Footer, Input, Static

from ecatd.base.addresses import address_text
from ecatd.base.daemon_threads import in_daemon_thread
from ecatd.base.errors import EcatError, SdoAbortError
from ecatd.base.sanitized_output import printable
from ecatd.etg.dictionary import Access, DictionaryEntry, DictionaryObject, access_text
from ecatd.etg.error_codes import abort_advice
from ecatd.operations.objects import ListObjects

from ..dictionary import described_value, read_value, type_text
from ..sdo import physical_text, to_write, value_text
from .ask import Ask
from .filter_line import FilterLine
from .lines import Column, Line, Lines

if TYPE_CHECKING:
    from ecatd.client.remote import Remote, SdoValue
    from ecatd.description.bus import Slave

    from .feed import Feed

_DRAW_S = 0.2
"""Seconds between two changes of the list while objects are being described."""
_KEYS = "Enter opens and reads, e writes, / filters."

Place = tuple[int, int]
"""Index and subindex."""


class ObjectLines(Lines):
    """The list."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter", "choose", "Read"),
        Binding("right", "open(True)", show=False),
        Binding("left", "open(False)", show=False),
    ]

    def action_open(self, is_open: bool) -> None:
        """Opens or closes the object under the cursor."""
        if isinstance(self.screen, Objects) and self.key is not None:
            self.screen.open(self.key, is_open)


class Objects(Screen[None]):
    """The object dictionary of one slave."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,q", "back", "Back"),
        Binding("e", "edit", "Write…"),
        Binding("l,L,v,t", "none", show=False),
    ]

    def __init__(self, feed: Feed, slave: Slave) -> None:
        super().__init__()
        self._feed = feed
        self._slave = slave
        self._objects: dict[int, DictionaryObject | None] = {}  # None: not described yet
        self._open: set[int] = set()
        self._values: dict[Place, str] = {}
        self._places: dict[str, Place] = {}  # of lines that have a value
        self._why_not = ""  # the user may not write
        self._drawn = 0.0

    def compose(self) -> ComposeResult:
        """Title, list, line of messages."""
        yield Static(Text(f"Objects of {printable(self._slave.label)}", "bold"), id="title")
        yield FilterLine()
        yield ObjectLines(
            (
                Column("OBJECT", 12),
                Column("TYPE", 10, 14),
                Column("ACCESS", 6, 24),
                Column("VALUE", 20, 40),
                Column("NAME", 18),
            )
        )
        yield Static(id="detail", markup=False)
        yield Static("Asking which objects there are…", id="message", markup=False)
        yield Footer(show_command_palette=False)

    def on_mount(self) -> None:
        """Begins to read the dictionary."""
        self.set_focus(self._lines)
        self._beside(self._look)

    @property
    def _lines(self) -> ObjectLines:
        return self.query_one(ObjectLines)

    def _beside(self, call: Callable[[], None]) -> None:
        """Calls in a thread that does not delay the end, however slow a slave is."""
        self.run_worker(in_daemon_thread(call))

    # --- what there is ----------------------------------------------------------------------------

    def _look(self) -> None:
        try:
            remote = self._feed.asking()
            indices = sorted(remote.request(ListObjects(self._slave.position))["objects"])
            self._tell(self._list, indices)
            try:
                self._why_not = remote.why_not("sdo", self._slave)
            except EcatError as error:
                self._why_not = str(error)
            self._describe(remote, indices)
        except EcatError as error:
            self._tell(self._say, printable(str(error)))
        except RuntimeError:  # the screen was closed meanwhile
            return

    def _tell(self, call: object, *arguments: object) -> None:
        """Calls in the thread of the screen.

        Raises:
            RuntimeError: The screen was closed.
        """
        if not self.is_attached:
            raise RuntimeError("closed")
        self.app.call_from_thread(call, *arguments)  # type: ignore[arg-type]

    def _list(self, indices: list[int]) -> None:
        self._objects = dict.fromkeys(indices)
        self._draw()

    def _describe(self, remote: Remote, indices: list[int]) -> None:
        asked: deque[int] = deque()

        def seen_first() -> Iterator[int]:
            missing = dict.fromkeys(indices)
            while missing:
                seen = (int(key[:6], 16) for key in self._lines.seen)
                index = next((index for index in seen if index in missing), next(iter(missing)))
                del missing[index]
                asked.append(index)
                yield index

        described = remote.describe_objects(self._slave.position, seen_first())
        for number, found in enumerate(described, 1):
            index = asked.popleft()
            if isinstance(found, SdoAbortError):  # a slave may list what it does not describe
                found = DictionaryObject(index, f"not described: {found.text}", 0, 0)
            elif isinstance(found, EcatError):
                raise found
            said = f"{number} of {len(indices)} objects described. {_KEYS}"
            if number == len(indices):
                said = f"{number} objects. {_KEYS}"
            self._objects[index] = found
            if number == len(indices) or time.monotonic() - self._drawn > _DRAW_S:
                self._tell(self._show_described, said)

    def _show_described(self, said: str) -> None:
        self._drawn = time.monotonic()
        self._say(said)
        self._draw()

    # --- the list ---------------------------------------------------------------------------------

    def _draw(self) -> None:
        self._places.clear()
        self._lines.empty = "No object has this in its name or address"
        self._lines.fill([*self._make_lines(self.query_one(FilterLine).text)])

    def _make_lines(self, wanted: str) -> Iterator[Line]:
        for index, found in self._objects.items():
            key = f"0x{index:04X}"
            if found is None:
                if wanted in key.casefold():
                    yield _line(key, f"  {key}", name=Text("…", "dim"), detail=f"{key}: …")
                continue
            name = printable(found.name)
            fits = wanted in f"{key} {name}".casefold()
            if _is_single(found):
                if fits:
                    yield self._entry_line((index, 0), found.entries[0], name, f"  {key}:00")
                continue
            texts = {
                subindex: f"{address_text(index, subindex)} {entry.name}".casefold()
                for subindex, entry in found.entries.items()
            }
            fitting = [subindex for subindex, text in texts.items() if fits or wanted in text]
            if not fits and not fitting:
                continue
            is_open = index in self._open or (not fits and bool(wanted))
            mark = ("▼" if is_open else "►") if found.entries else " "
            count = f"{len(found.entries)} entries" if found.entries else ""
            detail = f"{key} {name}: {count or 'no entries'}"
            yield _line(key, f"{mark} {key}", Text(count, "dim"), Text(name, "bold"), detail)
            if is_open:
                for subindex in fitting:
                    entry = found.entries[subindex]
                    title = f"    {printable(entry.name)}"
                    yield self._entry_line(
                        (index, subindex), entry, title, f"       :{subindex:02X}"
                    )

    def _entry_line(self, place: Place, entry: DictionaryEntry, title: str, head: str) -> Line:
        key = address_text(*place)
        self._places[key] = place
        access = access_text(entry.access)
        value = self._values.get(place, "")
        facts = [f"{key} {title.strip()}: {type_text(entry)}, {access}", *_limits(entry)]
        return Line(
            key,
            (
                Text(head),
                Text(type_text(entry), "dim"),
                Text(access, "" if entry.access & Access.WRITE else "dim"),
                Text(value, "red" if value.startswith("refused") else "bold"),
                Text(title),
            ),
            ", ".join([*facts, *([f"now {value}"] if value else [])]),
        )

    @on(Lines.Moved)
    def _moved(self) -> None:
        self.query_one("#detail", Static).update(Text(self._lines.detail))

    def _say(self, text: str) -> None:
        if self.is_attached:
            self.query_one("#message", Static).update(Text(text))

    @on(Input.Changed, "#filter")
    def _filter(self) -> None:
        self._draw()

    @on(Input.Submitted, "#filter")
    def _filtered(self) -> None:
        self.set_focus(self._lines)

    def action_none(self) -> None:
        """Keys of the other screen that have no sense here."""

    def action_back(self) -> None:
        """Back to the bus; first out of the filter."""
        if self.query_one(FilterLine).end():
            self.set_focus(self._lines)
        else:
            self.dismiss()

    # --- reading ----------------------------------------------------------------------------------

    @on(Lines.Chosen)
    def _chosen(self, event: Lines.Chosen) -> None:
        if event.key in self._places:
            self._say(f"Reading {event.key}…")
            places = [self._places[event.key]]
            self._beside(lambda: self._read(places))
        else:
            self.open(event.key, int(event.key, 16) not in self._open)

    def open(self, key: str, is_open: bool) -> None:
        """Opens an object, which reads its values, or closes it.

        Args:
            key: Of its line, or of the line of one of its entries.
            is_open: Whether it shall be open.
        """
        index = int(key[:6], 16)
        found = self._objects[index]
        if found is None or _is_single(found) or is_open == (index in self._open):
            return
        if is_open:
            self._open.add(index)
            places = [(index, subindex) for subindex, e in found.entries.items() if e.access & 7]
            self._beside(lambda: self._read(places, is_whole=True))
        else:
            self._open.discard(index)
            self._lines.move_to(key[:6])
        self._draw()

    def _entry(self, place: Place) -> DictionaryEntry:
        found = self._objects[place[0]]
        assert found is not None, "only described objects have places"
        return found.entries[place[1]]

    def _read(self, places: list[Place], *, is_whole: bool = False) -> None:
        try:
            remote = self._feed.asking()
            for place in places:
                try:
                    found = read_value(remote, self._slave.position, *place, self._entry(place))
                except SdoAbortError as error:
                    if not is_whole:
                        raise
                    self._tell(self._note, place, f"refused: {error.text}")
                else:
                    self._tell(self._show, place, found, "")
        except EcatError as error:
            where = address_text(*places[0]) if len(places) == 1 else f"0x{places[0][0]:04X}"
            self._tell(self._say, f"{where} was not read: {_why(error)}")
        except RuntimeError:  # the screen was closed meanwhile
            return

    def _note(self, place: Place, text: str) -> None:
        self._values[place] = printable(text)
        self._draw()

    def _show(self, place: Place, found: SdoValue, done: str) -> None:
        physical = physical_text(found)
        self._note(place, value_text(found) + (f" = {physical}" if physical else ""))
        self._say(f"{done}{address_text(*place)} {printable(found.name)}: {self._values[place]}")

    # --- writing ----------------------------------------------------------------------------------

    def action_edit(self) -> None:
        """Asks for a value, and writes it."""
        key = self._lines.key
        place = self._places.get(key or "")
        if key is None or place is None:
            self._say("Open an object, and choose one of its entries to write it.")
            return
        entry = self._entry(place)
        if self._why_not:
            self._say(f"You may not write objects: {self._why_not}")
            return
        if not entry.access & Access.WRITE:
            self._say(f"{key} cannot be written: its access is {access_text(entry.access)}.")
            return

        def write(value: str | None) -> None:
            if value is None:
                self._say("Nothing was written.")
            else:
                self._say(f"Writing {key}…")
                self._beside(lambda: self._write(place, value))

        now = self._values.get(place, "")
        known = "" if now.startswith("refused") else now.partition(" = ")[0].rpartition(" ")[2]
        facts = [f"{type_text(entry)}, {access_text(entry.access)}", *_limits(entry)]
        what = f"{key} ({printable(entry.name)}) of {printable(self._slave.label)}"
        ask = Ask(f"New value of {what}", ", ".join(facts), known, "write it to the slave")
        self.app.push_screen(ask, write)

    def _write(self, place: Place, value: str) -> None:
        where = self._slave.position, *place
        try:
            remote = self._feed.asking()
            remote.sdo_write(*where, to_write(remote, *where, value))
            try:
                found = read_value(remote, *where, self._entry(place))
            except EcatError as error:  # many entries can only be written
                said = f"{address_text(*place)} was written; it cannot be read: {error}"
                self._tell(self._say, said)
            else:
                self._tell(self._show, place, found, "Written. ")
        except EcatError as error:
            self._tell(self._say, f"{address_text(*place)} was not written: {_why(error)}")
        except RuntimeError:  # the screen was closed meanwhile
            return


def _is_single(found: DictionaryObject) -> bool:
    """Whether an object is one value."""
    return [*found.entries] == [0]


def _line(
    key: str, head: str, count: Text | str = "", name: Text | str = "", detail: str = ""
) -> Line:
    cells = (Text(head), Text(""), Text(""), Text.assemble(count), Text.assemble(name))
    return Line(key, cells, detail)


def _limits(entry: DictionaryEntry) -> Iterator[str]:
    known: Mapping[str, bytes | None] = {
        "least": entry.minimum,
        "most": entry.maximum,
        "delivered as": entry.default,
    }
    for title, data in known.items():
        if data is not None:
            yield printable(f"{title} {described_value(entry, data)}")


def _why(error: EcatError) -> str:
    """Why it was refused, and what to do."""
    advice = abort_advice(error.code) if isinstance(error, SdoAbortError) else ""
    return printable(f"{error}{f': {advice}' if advice else ''}")
