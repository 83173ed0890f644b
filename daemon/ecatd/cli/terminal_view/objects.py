"""The objects of a slave: to browse, to read, and to write where the user may."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen, Screen
from textual.widgets import DataTable, Footer, Input, Label, Static

from ecatd.base.errors import EcatError
from ecatd.etg.dictionary import Access, DictionaryEntry, access_text
from ecatd.operations.objects import ListObjects

from ..dictionary import read_value, type_text
from ..sdo import physical_text, value_text

if TYPE_CHECKING:
    from ecatd.client.remote import SdoValue
    from ecatd.description.bus import Slave

    from .feed import Feed


@dataclass(frozen=True, slots=True)
class _Place:
    """An entry of an object."""

    index: int
    subindex: int
    entry: DictionaryEntry

    @property
    def address(self) -> str:
        """`0x6060:00`."""
        return f"0x{self.index:04X}:{self.subindex:02X}"


class Ask(ModalScreen[str | None]):
    """Asks for a value, and then whether to write it."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "cancel", "Cancel")]

    def __init__(self, what: str, value: str) -> None:
        super().__init__()
        self._what = what
        self._value = value
        self._typed: str | None = None

    def compose(self) -> ComposeResult:
        """The question."""
        with Vertical(id="box"):
            yield Label(f"New value of {self._what}", markup=False)
            yield Input(self._value, id="value")
            yield Label("Enter goes on, Esc cancels.", id="hint", markup=False)

    @on(Input.Submitted)
    def typed(self, event: Input.Submitted) -> None:
        """First Enter: what will be done. Second Enter: do it."""
        if self._typed == event.value:
            self.dismiss(event.value)
            return
        self._typed = event.value
        self.query_one("#hint", Label).update(
            f"Write {event.value!r} to the slave? Enter writes, Esc cancels."
        )

    def action_cancel(self) -> None:
        """Writes nothing."""
        self.dismiss(None)


class Objects(Screen[None]):
    """The object dictionary of one slave."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,q", "back", "Back"),
        Binding("enter", "read", "Read", priority=False),
        Binding("e", "edit", "Write…"),
        Binding("slash", "filter", "Filter"),
    ]

    def __init__(self, feed: Feed, slave: Slave) -> None:
        super().__init__()
        self._feed = feed
        self._slave = slave
        self._places: list[tuple[_Place, str]] = []
        self._values: dict[str, str] = {}

    def compose(self) -> ComposeResult:
        """Title, table, line of messages."""
        yield Static(Text(f"Objects of {self._slave.label}", "bold"), id="title")
        yield Input(placeholder="text in the name or address", id="filter")
        yield DataTable(cursor_type="row", zebra_stripes=False)
        yield Static("Reading what objects there are…", id="message", markup=False)
        yield Footer()

    def on_mount(self) -> None:
        """Begins to read the dictionary."""
        table = self.query_one(DataTable)
        for name, width in (("OBJECT", 10), ("TYPE", 12), ("ACCESS", 9), ("VALUE", 20)):
            table.add_column(name, width=width, key=name)
        table.add_column("NAME", key="NAME")
        self.query_one("#filter").display = False
        table.focus()
        self._list()

    @work(thread=True, exclusive=True, group="list")
    def _list(self) -> None:
        try:
            with self._feed.open() as remote:
                indices = sorted(remote.request(ListObjects(self._slave.position))["objects"])
                for number, index in enumerate(indices, 1):
                    if not self.is_attached:
                        return
                    found = remote.describe_object(self._slave.position, index)
                    single = [*found.entries] == [0]
                    places = [
                        (
                            _Place(index, subindex, entry),
                            found.name if single else f"{found.name}: {entry.name}",
                        )
                        for subindex, entry in found.entries.items()
                    ]
                    said = f"{number} of {len(indices)} objects"
                    self.app.call_from_thread(self._add, places, said)
        except EcatError as error:
            self.app.call_from_thread(self._say, str(error))
        except RuntimeError:  # the screen was closed meanwhile
            return

    def _add(self, places: list[tuple[_Place, str]], said: str) -> None:
        self._places += places
        for place, name in places:
            self._add_row(place, name)
        self._say(f"{said}. Enter reads a value, e writes one.")

    def _add_row(self, place: _Place, name: str) -> None:
        wanted = self.query_one("#filter", Input).value.casefold()
        if wanted in f"{place.address} {name}".casefold():
            self.query_one(DataTable).add_row(
                Text(place.address),
                Text(type_text(place.entry)),
                Text(access_text(place.entry.access)),
                Text(self._values.get(place.address, "")),
                Text(name),
                key=place.address,
            )

    def _say(self, text: str) -> None:
        if self.is_attached:
            self.query_one("#message", Static).update(text)

    @on(Input.Changed, "#filter")
    def _filter(self) -> None:
        self.query_one(DataTable).clear()
        for place, name in self._places:
            self._add_row(place, name)

    @on(Input.Submitted, "#filter")
    def _filtered(self) -> None:
        self.query_one(DataTable).focus()

    def action_filter(self) -> None:
        """Shows the line for the filter."""
        field = self.query_one("#filter")
        field.display = True
        field.focus()

    def action_back(self) -> None:
        """Back to the bus; first out of the filter."""
        field = self.query_one("#filter", Input)
        if field.has_focus:
            field.value = ""
            field.display = False
            self.query_one(DataTable).focus()
        else:
            self.dismiss()

    @property
    def _place(self) -> _Place | None:
        table = self.query_one(DataTable)
        if not table.row_count:
            return None
        key = table.coordinate_to_cell_key(table.cursor_coordinate).row_key.value
        return next((place for place, _ in self._places if place.address == key), None)

    @on(DataTable.RowSelected)
    def _selected(self) -> None:
        self.action_read()

    def action_read(self) -> None:
        """Reads the value of the entry under the cursor."""
        if (place := self._place) is not None:
            self._say(f"Reading {place.address}…")
            self._read(place)

    @work(thread=True, group="values")
    def _read(self, place: _Place) -> None:
        try:
            with self._feed.open() as remote:
                found = read_value(
                    remote, self._slave.position, place.index, place.subindex, place.entry
                )
        except EcatError as error:
            self.app.call_from_thread(self._say, f"{place.address}: {error}")
            return
        self.app.call_from_thread(self._show, place, found, "")

    def _show(self, place: _Place, found: SdoValue, done: str) -> None:
        physical = physical_text(found)
        text = value_text(found) + (f" = {physical}" if physical else "")
        self._values[place.address] = text
        if not self.is_attached:
            return
        table = self.query_one(DataTable)
        if place.address in table.rows:
            table.update_cell(place.address, "VALUE", Text(text))
        self._say(f"{done}{place.address} {found.name}: {text}")

    def action_edit(self) -> None:
        """Asks for a value, and writes it."""
        place = self._place
        if place is None:
            return
        if not place.entry.access & Access.WRITE:
            self._say(f"{place.address} cannot be written: its access is read only.")
            return

        def write(value: str | None) -> None:
            if value is None:
                self._say("Nothing was written.")
            else:
                self._say(f"Writing {place.address}…")
                self._write(place, value)

        known = self._values.get(place.address, "").partition(" = ")[0].rpartition(" ")[2]
        what = f"{place.address} ({place.entry.name}) of {self._slave.label}"
        self.app.push_screen(Ask(what, known), write)

    @work(thread=True, group="values")
    def _write(self, place: _Place, value: str) -> None:
        try:
            with self._feed.open() as remote:
                remote.sdo_write(self._slave.position, place.index, place.subindex, value)
                found = read_value(
                    remote, self._slave.position, place.index, place.subindex, place.entry
                )
        except EcatError as error:
            self.app.call_from_thread(self._say, f"{place.address} was not written: {error}")
            return
        self.app.call_from_thread(self._show, place, found, "Written. ")
