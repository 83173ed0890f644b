"""A question in front of the screen: for a value, and then whether to do it."""

from __future__ import annotations

from typing import ClassVar

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Input, Label


class Ask(ModalScreen[str | None]):
    """Gives the value, or None.

    Args:
        title: What the value is for.
        facts: What to know about it.
        value: The value that is there now.
        act: What the second Enter does: `write it to the slave`.
    """

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "cancel", "Cancel")]

    def __init__(self, title: str, facts: str, value: str, act: str) -> None:
        super().__init__()
        self._title = title
        self._facts = facts
        self._value = value
        self._act = act
        self._typed: str | None = None

    def compose(self) -> ComposeResult:
        """The question."""
        with Vertical(id="box"):
            yield Label(self._title, id="what", markup=False)
            yield Label(self._facts, id="facts", markup=False)
            yield Input(self._value, id="value", select_on_focus=True)
            yield Label("Enter goes on, Esc cancels.", id="hint", markup=False)

    @on(Input.Submitted)
    def typed(self, event: Input.Submitted) -> None:
        """First Enter: what will be done. Second Enter: do it."""
        if not event.value.strip():
            return
        if self._typed == event.value:
            self.dismiss(event.value)
            return
        self._typed = event.value
        self._hint(f"{event.value}: press Enter again to {self._act}. Esc cancels.")
        self.query_one("#hint").add_class("sure")

    @on(Input.Changed)
    def changed(self, event: Input.Changed) -> None:
        """Another value is another question."""
        if self._typed is not None and event.value != self._typed:
            self._typed = None
            self._hint("Enter goes on, Esc cancels.")
            self.query_one("#hint").remove_class("sure")

    def _hint(self, text: str) -> None:
        self.query_one("#hint", Label).update(text)

    def action_cancel(self) -> None:
        """Does nothing."""
        self.dismiss(None)
