"""Collects what is wrong in ESI and ENI files and does not keep their rest from being used.

The rule for all vendors' files: what can be understood is used; what cannot is named and left out;
and only what would make wrong numbers refuses. Whoever wants tidy files asks for `strict`.
"""

from __future__ import annotations

from ecatd.base.errors import ConfigError


class MalformedError(ConfigError):
    """A part of a file is malformed.

    Attributes:
        path: The file.
        line: Line of the part.
        text: What is wrong with it.
    """

    def __init__(self, path: str, line: int, text: str) -> None:
        super().__init__(f"{path}:{line}: {text}")
        self.path, self.line, self.text = path, line, text


class Findings:
    """What was left out of files, or is used in another way than the file says.

    Args:
        strict: Whether each finding refuses the file.

    Attributes:
        strict: See above.
        part: The part of a file that is being read, for files that have everything on one line.
    """

    def __init__(self, *, strict: bool = False) -> None:
        self.strict = strict
        self.part = ""
        self._texts: dict[str, tuple[int, str]] = {}

    def add(self, path: str, line: int, text: str, effect: str) -> None:
        """Adds a finding; the same one counts once.

        Args:
            path: The file.
            line: The line.
            text: What is wrong.
            effect: How it is used, or that it is left out.

        Raises:
            MalformedError: Findings are strict.
        """
        if self.strict:
            raise MalformedError(path, line, text)
        text += f" (in {self.part})" if self.part else ""
        self._texts.setdefault(f"{path}:{line}: {text}; {effect}", (line, f"{text}; {effect}"))

    def take(self, others: Findings) -> None:
        """Adds the findings of others."""
        for text, parts in others._texts.items():
            self._texts.setdefault(text, parts)

    def say(self, text: str) -> None:
        """Adds a finding about a whole file.

        Raises:
            ConfigError: Findings are strict.
        """
        if self.strict:
            raise ConfigError(text)
        self._texts.setdefault(text, (0, text))

    @property
    def texts(self) -> list[str]:
        """All findings; most begin with file and line."""
        return list(self._texts)

    @property
    def by_line(self) -> list[tuple[int, str]]:
        """Line and text of all findings; line 0 for those about a whole file."""
        return list(self._texts.values())

    def __len__(self) -> int:
        return len(self._texts)
