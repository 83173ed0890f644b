"""The report of a run: the changes that it has made or would make."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..differences import Difference, lines

_NAMED = 3  # most files that a line names


@dataclass(frozen=True, slots=True)
class Report:
    """The result of `generate`; paths are relative to the output directory.

    Attributes:
        library: Folder of the generated library.
        packages: Names of all packages that were written, in the order in which a tool loads them.
        written: Files that are new or have changed.
        unchanged: Files that have not changed.
        removed: Files of an earlier run that are no longer generated.
        kept: Files of the user.
        copies: Files of the user that were in the way, with their new names.
        conflicts: Files of the user that are in the way, with the reason.
        regenerated: Files whose generated content differs from that of the run before.
        differences: Differences of the bus, by slave and connector.
        otherwise: The files of `regenerated` that would differ for the same bus, too.
        notes: A sentence for each block that is missing or has another name, with the reason.
    """

    library: Path
    packages: tuple[str, ...]
    written: tuple[str, ...]
    unchanged: tuple[str, ...]
    removed: tuple[str, ...]
    kept: tuple[str, ...] = ()
    copies: tuple[tuple[str, str], ...] = ()
    conflicts: tuple[tuple[str, str], ...] = ()
    regenerated: tuple[str, ...] = ()
    differences: tuple[Difference, ...] = ()
    otherwise: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def is_change(self) -> bool:
        """Whether anything has changed, or would change."""
        return bool(self.written or self.removed or self.conflicts)

    def to_dict(self) -> dict[str, Any]:
        """Returns the report as data, for JSON."""
        return {
            "library": str(self.library),
            "changed": self.is_change,
            "written": list(self.written),
            "unchanged": list(self.unchanged),
            "removed": list(self.removed),
            "kept": list(self.kept),
            "copies": dict(self.copies),
            "conflicts": dict(self.conflicts),
            "differences": [item.to_dict() for item in self.differences],
            "generator": list(self.otherwise),
            "notes": list(self.notes),
        }

    def details(self) -> list[str]:
        """Returns notes, differences and renamed files, one sentence per line."""
        text = [*self.notes, *lines(self.differences)]
        if self.otherwise:
            text.append(
                f"{_files(len(self.otherwise))} would differ for the same bus, too "
                f"({_named(self.otherwise)}): ecatd or a template has changed"
            )
        text += [f"{path} is kept as {copy}" for path, copy in self.copies]
        return text

    def summary(self) -> str:
        """Returns the report as one sentence."""
        names = [str(self.library.parent / name / "package.mo") for name in self.packages]
        return (
            f"{self.library}: {self._counts()}; open {' and then '.join(names)} in a Modelica tool"
        )

    def would(self) -> str:
        """Returns the changes that a run would make, as one sentence."""
        if not self.is_change:
            return f"{self.library}: nothing would change"
        text = f"{self.library} would change: {self._counts()}"
        if self.conflicts:
            named = ", ".join(f"{path} ({why})" for path, why in self.conflicts)
            text += f"; it would be refused without --force because of {named}"
        return text

    def _counts(self) -> str:
        counts = f"{_files(len(self.written))} written, {len(self.unchanged)} unchanged"
        if self.removed:
            counts += f", {len(self.removed)} removed"
        if self.kept:
            counts += f", {len(self.kept)} of yours kept"
        return counts


def _named(paths: Sequence[str]) -> str:
    more = len(paths) - _NAMED
    return ", ".join([*paths[:_NAMED], *([f"{more} more"] if more > 0 else [])])


def _files(count: int) -> str:
    return f"{count} file{'s' * (count != 1)}"
