"""The line for a text that names must have."""

from __future__ import annotations

from textual.app import ComposeResult
from textual.containers import Horizontal
from textual.widgets import Input, Label


class FilterLine(Horizontal):
    """Is hidden while there is no filter. Its field has the id `filter`."""

    def compose(self) -> ComposeResult:
        """Title and field."""
        yield Label("Filter: ")
        yield Input(placeholder="only what has this in its name or address", id="filter")

    @property
    def text(self) -> str:
        """The text, in lower case."""
        return self.query_one(Input).value.casefold()

    def open(self) -> None:
        """Lets the user type."""
        self.display = True
        self.screen.set_focus(self.query_one(Input))  # at once: keys may have been typed ahead

    def end(self) -> bool:
        """Shows all again; returns whether there was a filter."""
        was_open = self.display
        self.query_one(Input).value = ""
        self.display = False
        return was_open
