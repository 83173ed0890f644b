"""A list with columns and a cursor.

It draws only the lines that are seen, so thousands of objects cost no more than twenty.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

from rich.text import Text
from textual.binding import Binding, BindingType
from textual.events import Click, Resize
from textual.geometry import Size
from textual.message import Message
from textual.scroll_view import ScrollView
from textual.strip import Strip

_GAP = 2


class Column(NamedTuple):
    """A column. The last one has what the others leave of the line.

    Attributes:
        title: Its head.
        least: Its width in a narrow terminal.
        most: Its width in a wide one.
        right: Whether its cells stand at the right.
    """

    title: str
    least: int
    most: int = 0
    right: bool = False


class Line(NamedTuple):
    """A line of a list.

    Attributes:
        key: What it is about: the cursor stays with it.
        cells: A text for each column.
        detail: What to show of it while the cursor is there.
    """

    key: str
    cells: Sequence[Text]
    detail: str = ""


class Lines(ScrollView, can_focus=True):
    """The list.

    Args:
        columns: Its columns.
        empty: What it says while it has no lines.
        settings: As of other widgets.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "go(-1)", show=False),
        Binding("down", "go(1)", show=False),
        Binding("pageup", "page(-1)", show=False),
        Binding("pagedown", "page(1)", show=False),
        Binding("home", "go(-1000000)", show=False),
        Binding("end", "go(1000000)", show=False),
    ]

    class Moved(Message):
        """Another line is under the cursor, or it says something else."""

    class Chosen(Message):
        """Enter was pressed, or the line under the cursor was clicked."""

        def __init__(self, lines: Lines, key: str) -> None:
            super().__init__()
            self.lines = lines
            self.key = key

        @property
        def control(self) -> Lines:
            """The list; for `on`."""
            return self.lines

    def __init__(self, columns: Sequence[Column], empty: str = "", **settings: Any) -> None:
        super().__init__(**settings)
        self.columns = columns
        self.empty = empty
        self.keys: list[str] = []
        self.cursor = 0
        self._lines: Sequence[Line] = ()

    def fill(self, lines: Sequence[Line], *, newest_first: bool = False) -> None:
        """Shows other lines; the cursor stays with what it was at.

        Args:
            lines: The lines.
            newest_first: Whether a cursor at the first line stays there.
        """
        self._lines = lines
        self.set_keys([line.key for line in lines], newest_first=newest_first)

    def set_keys(self, keys: list[str], *, newest_first: bool = False) -> None:
        """As `fill`, for a list that makes its lines when they are drawn."""
        key = self.key
        self.keys = keys
        if key is not None and key in keys and not (newest_first and self.cursor == 0):
            self.cursor = keys.index(key)
        self.cursor = max(0, min(self.cursor, len(keys) - 1))
        self.virtual_size = Size(0, len(keys) + 1)
        self._follow()

    def line(self, number: int) -> Line:
        """A line, when it is drawn."""
        return self._lines[number]

    @property
    def key(self) -> str | None:
        """The key of the line under the cursor."""
        return self.keys[self.cursor] if self.keys else None

    @property
    def detail(self) -> str:
        """What the line under the cursor says, not cut off."""
        return self.line(self.cursor).detail if self.keys else ""

    @property
    def seen(self) -> list[str]:
        """The keys of the lines that are seen."""
        first = self.scroll_offset.y
        return self.keys[first : first + self.size.height - 1]

    def move_to(self, key: str) -> None:
        """Puts the cursor onto a line, if there is one with this key."""
        if key in self.keys:
            self.cursor = self.keys.index(key)
            self._follow()

    def action_go(self, by: int) -> None:
        """Moves the cursor."""
        self.cursor = max(0, min(self.cursor + by, len(self.keys) - 1))
        self._follow()

    def action_page(self, by: int) -> None:
        """Moves the cursor by a screenful."""
        self.action_go(by * max(1, self.size.height - 2))

    def action_choose(self) -> None:
        """Says that the user wants what is under the cursor."""
        if (key := self.key) is not None:
            self.post_message(self.Chosen(self, key))

    def on_click(self, event: Click) -> None:
        """Moves the cursor; a click where it is chooses."""
        number = event.y - 1 + self.scroll_offset.y
        if event.y < 1 or number >= len(self.keys):
            return
        if number == self.cursor:
            self.action_choose()
        else:
            self.action_go(number - self.cursor)

    def on_resize(self, _event: Resize) -> None:
        """Keeps the cursor in view."""
        self._follow()

    def on_focus(self) -> None:
        """Draws the cursor."""
        self.refresh()

    on_blur = on_focus

    def _follow(self) -> None:
        room = max(1, self.size.height - 1)
        top = self.scroll_offset.y
        if self.cursor < top:
            self.scroll_to(y=self.cursor, animate=False)
        elif self.cursor >= top + room:
            self.scroll_to(y=self.cursor - room + 1, animate=False)
        self.refresh()
        self.post_message(self.Moved())

    @property
    def _width(self) -> int:
        """The width without the bar at the right."""
        return self.scrollable_content_region.width

    def widths(self) -> list[int]:
        """The width of each column: half of the room to spare is for the last one."""
        spare = self._width - 1 - sum(column.least + _GAP for column in self.columns) + _GAP
        wishes = [max(0, column.most - column.least) for column in self.columns[:-1]]
        share = min(1.0, max(0, spare) / 2 / max(1, sum(wishes)))
        more = [int(wish * share) for wish in wishes]
        widths = [column.least + part for column, part in zip(self.columns, more, strict=False)]
        return [*widths, max(0, self.columns[-1].least + spare - sum(more))]

    def render_line(self, y: int) -> Strip:
        """The head, a line, or nothing."""
        number = y - 1 + self.scroll_offset.y
        cells: Sequence[Text]
        if y == 0:
            cells = [Text(column.title, "bold") for column in self.columns]
        elif number < len(self.keys):
            cells = self.line(number).cells
        elif y == 1:
            return self._strip(Text.assemble((f" {self.empty}", "dim")))
        else:
            return self._strip(Text())
        line = Text(" ", no_wrap=True)
        for place, (cell, column, width) in enumerate(
            zip(cells, self.columns, self.widths(), strict=True)
        ):
            shown = cell.copy()
            shown.truncate(width, overflow="ellipsis")
            room = " " * (width - shown.cell_len)
            line.append_text(Text.assemble(room, shown) if column.right else shown + Text(room))
            if place < len(self.columns) - 1:
                line.append(" " * _GAP)
        if y and number == self.cursor:
            line = Text(line.plain)  # in one colour
            line.stylize("reverse" if self.has_focus else "underline")
        return self._strip(line)

    def _strip(self, line: Text) -> Strip:
        segments = [*line.render(self.app.console)]
        return Strip(segments).adjust_cell_length(self._width)
