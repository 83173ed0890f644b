"""The top lines: seven lamps, and a sentence about the worst or the chosen one."""

from __future__ import annotations

import time
from collections.abc import Sequence

from rich.text import Text
from textual.events import Click, Resize
from textual.message import Message
from textual.widgets import Static

from ecatd.view.lamps import Lamp

from .glyphs import MARKS, STYLES

_SHORT = {
    "slaves_in_op": "OP",
    "working_counter": "WKC",
    "frames_lost": "Frames",
    "number_of_slaves": "Slaves",
}
_ORDER = ("bad", "warning", "unknown", "good")


class LampLine(Static):
    """The lamps; a click on one shows its sentence and its evidence."""

    class Chosen(Message):
        """The user wants to see the evidence of a lamp."""

        def __init__(self, lamp: Lamp) -> None:
            super().__init__()
            self.lamp = lamp

    def __init__(self) -> None:
        super().__init__()
        self.lamps: Sequence[Lamp] = ()
        self._chosen: int | None = None
        self._ends: list[int] = []

    def show(self, lamps: Sequence[Lamp]) -> None:
        """Draws lamps."""
        self.lamps = lamps
        self._draw()

    def step(self, by: int) -> None:
        """Chooses the next lamp, or the one before."""
        if self.lamps:
            self._chosen = ((self._chosen if self._chosen is not None else -1) + by) % len(
                self.lamps
            )
            self._draw()

    @property
    def lamp(self) -> Lamp | None:
        """The chosen lamp, else the worst one."""
        if not self.lamps:
            return None
        if self._chosen is not None:
            return self.lamps[self._chosen]
        return min(self.lamps, key=lambda lamp: _ORDER.index(lamp["state"]))

    def on_resize(self, _event: Resize) -> None:
        """Titles are short in a narrow terminal."""
        self._draw()

    def on_click(self, event: Click) -> None:
        """Chooses the lamp."""
        if event.y == 0:
            for number, end in enumerate(self._ends):
                if event.x < end:
                    self._chosen = None if self._chosen == number else number
                    self._draw()
                    return
        elif (lamp := self.lamp) is not None:
            self.post_message(self.Chosen(lamp))

    def _draw(self) -> None:
        long = self.size.width >= 108
        line, self._ends = Text(no_wrap=True), []
        for number, lamp in enumerate(self.lamps):
            title = lamp["title"] if long else _SHORT.get(lamp["id"], lamp["title"])
            style = STYLES[lamp["state"]]
            line.append(f"{MARKS[lamp['state']]} ", style)
            line.append(title, f"{style} reverse" if number == self._chosen else style)
            self._ends.append(line.cell_len + 1)
            line.append("   " if long else "  ")
        sentence = Text()
        if (shown := self.lamp) is not None:
            all_good = all(each["state"] == "good" for each in self.lamps)
            if self._chosen is None and all_good:
                sentence.append("All is well.", "green")
            else:
                sentence.append(f"{shown['title']}: ", f"{STYLES[shown['state']]} bold")
                sentence.append(shown["text"])
                if shown["since"] and shown["state"] != "good":
                    since = time.strftime("%H:%M:%S", time.localtime(shown["since"]))
                    sentence.append(f" (since {since})", "dim")
        else:
            sentence.append("Waiting for the first answer…", "dim")
        self.update(Text("\n").join([line, sentence]))
