"""The installed files: the list of them, `installed.json`, and what was there before.

Each place has something that is wanted there, something that the list says, and something that is
there: `entry` and `found` put all of them into the same words.
"""

from __future__ import annotations

import glob
import hashlib
import itertools
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path, PurePosixPath

from ecatd.base.errors import StateError
from ecatd.base.version import VERSION

from .actions import Action, copy, link, remove_empty, write
from .places import LOCAL, Place

LIST = LOCAL["share"] / "ecatd/installed.json"
_BEFORE = ".before-ecatd"
"""Suffix of a file that was there before the installation. The removal restores it."""
_OLD = ".ecatd-old"
"""Suffix of a file of ecatd that the administrator had changed before an upgrade."""
_LINK, _OTHER = "link:", "other"


@dataclass(frozen=True, slots=True)
class Record:
    """What is installed.

    Attributes:
        files: The `entry` of each file and link by its path.
        folders: The folders that the installation has made.
    """

    files: Mapping[str, str] = field(default_factory=dict)
    folders: frozenset[str] = frozenset()

    def to_json(self) -> bytes:
        """The content of the list."""
        document = {
            "version": VERSION,
            "files": dict(self.files),
            "folders": sorted(self.folders),
        }
        return json.dumps(document, indent=1, sort_keys=True).encode() + b"\n"


def read_record(place: Place) -> Record:
    """Reads what is installed in a file system: nothing if there is no list.

    Raises:
        StateError: The list is damaged.
    """
    try:
        document = json.loads(place.at(LIST).read_bytes())
        files = {str(path): str(text) for path, text in document["files"].items()}
        folders = frozenset(map(str, document["folders"]))
        for path in (*files, *folders):
            path.encode()
            if not path.startswith("/") or ".." in PurePosixPath(path).parts:
                raise ValueError(path)
        return Record(files, folders)
    except OSError:
        return Record()
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise StateError(
            f"{LIST} is damaged, so what is installed is not known: remove it, and install again"
        ) from error


def entry(content: bytes | Path) -> str:
    """What the list says of the content of a file, or of the target of a link."""
    if isinstance(content, Path):
        return f"{_LINK}{content}"
    return hashlib.sha256(content).hexdigest()


def found(file: Path) -> str:
    """The `entry` of what is there: empty for nothing, `other` for a folder and the like."""
    if file.is_symlink():
        return entry(file.readlink())
    try:
        return entry(file.read_bytes()) if file.is_file() else _OTHER if file.exists() else ""
    except OSError:
        return _OTHER


def _is_file(text: str) -> bool:
    return bool(text) and text != _OTHER and not text.startswith(_LINK)


def put(place: Place, wanted: Mapping[PurePosixPath, bytes | Path]) -> Iterator[Action]:
    """The actions that bring files and links up to date, and take away those that are listed only.

    Args:
        place: Where.
        wanted: The content of files and the targets of links by their path.

    Raises:
        StateError: A link among the folders above a file leads out of the file system of the image.
    """
    before = read_record(place)
    listed: dict[str, str] = {}
    saved: list[Action] = []
    actions: list[Action] = []
    for path, content in wanted.items():
        file, new = place.at(path), entry(content)
        there, old = found(file), before.files.get(str(path), "")
        if not place.holds(file):
            raise StateError(f"{file.parent} leads out of {place.root}: remove the link")
        if there not in ("", new, old) and not (_is_file(new) and _is_file(there)):
            why = "yours: a link or a folder"
            if isinstance(content, Path):
                why = f"another program, which is not {content}"
            actions.append(place.keep(file, why))
            continue
        listed[str(path)] = new
        if there == new:
            actions.append(place.keep(file, "up to date"))
        elif isinstance(content, Path):
            effect = partial(link, file, content)
            actions.append(place.action("link", file, f"to {content}", effect))
        else:
            if there not in ("", old):
                saved += _save(place, file, there, _OLD if old else _BEFORE)
            effect = partial(write, file, content)
            actions.append(place.action("write", file, "changed" if there else "new", effect))
    # An interrupted installation can be removed: it first copies foreign files, and then writes the
    # list.
    yield from saved
    record = Record(listed, before.folders | _missing_folders(place, listed)).to_json()
    if found(place.at(LIST)) != entry(record):
        effect = partial(write, place.at(LIST), record)
        yield place.action("write", place.at(LIST), "what is installed", effect)
    yield from actions
    gone = before.files.keys() - set(map(str, wanted))
    yield from _take_away(place, gone, before, "this version has no such file", purge=False)


def _save(place: Place, file: Path, there: str, suffix: str) -> Iterator[Action]:
    """Copies a file that the installation did not write, before it is replaced."""
    if any(found(saved) == there for end in (_BEFORE, _OLD) for saved in _copies(file, end)):
        return  # an interrupted installation has saved it
    numbers = itertools.chain([""], (f"-{number}" for number in itertools.count(2)))
    to = next(
        to for number in numbers if not found(to := file.with_name(f"{file.name}{suffix}{number}"))
    )
    seen = place.seen(file)
    why = f"{seen} as you have changed it" if suffix == _OLD else f"your own {seen}"
    yield Action("save", place.seen(to), why, partial(copy, file, to), to)


def _copies(file: Path, suffix: str) -> list[Path]:
    """The copies of a file, the oldest first."""
    copies = file.parent.glob(f"{glob.escape(file.name)}{suffix}*")
    return sorted(copies, key=lambda copy: (len(copy.name), copy.name))


def _missing_folders(place: Place, paths: Iterable[str]) -> set[str]:
    """The folders that the installation makes for these files and for its list."""
    above = {folder for path in (*paths, str(LIST)) for folder in PurePosixPath(path).parents}
    return {str(folder) for folder in above if not place.at(folder).exists()}


def take_away(place: Place, known: Iterable[PurePosixPath], *, purge: bool) -> Iterator[Action]:
    """The actions that remove what `put` has written, and restore what was there before.

    Args:
        place: Where.
        known: Files that `put` may have written, although they are not listed.
        purge: Remove files that were changed since then, and copies of such files, too.
    """
    record = read_record(place)
    paths = {*map(str, known), *record.files}
    actions = list(_take_away(place, paths, record, "", purge=purge))
    if record.files:
        file = place.at(LIST)
        actions.append(place.remove(file))
    yield from actions
    gone = {action.file for action in actions if action.verb in ("remove", "restore")}
    gone -= {place.at(action.what) for action in actions if action.verb == "restore"}
    for path in sorted(record.folders, key=len, reverse=True):  # folders before those above them
        folder = place.at(path)
        if folder.is_symlink() or not folder.is_dir() or not place.holds(folder):
            continue
        if gone.issuperset(folder.iterdir()):
            gone.add(folder)
            why = "a folder that is empty then"
            yield place.action("remove", folder, why, partial(remove_empty, folder))


def _take_away(
    place: Place, paths: Iterable[str], record: Record, why: str, *, purge: bool
) -> Iterator[Action]:
    for path in sorted(paths):
        file = place.at(path)
        if not place.holds(file):
            continue
        there, listed = found(file), record.files.get(path, "")
        if not (there and listed):
            is_free = not there
        elif there == listed:
            is_free = True
            yield place.remove(file, why)
        elif is_free := purge and _is_file(there) and _is_file(listed):
            yield place.remove(file, "you have changed it")
        else:
            what = "changed since it was installed: remove it yourself"
            yield place.keep(file, what)
        earlier = _copies(file, _BEFORE)
        if is_free and earlier:
            own = earlier.pop()
            what = f"from {place.seen(own)}, your own file"
            yield Action("restore", path, what, partial(own.replace, file), own)
        for own in earlier:
            yield place.keep(own, "your own file from before the installation")
        for old in _copies(file, _OLD):
            yield place.remove_or_keep(old, f"{path} as you had changed it", purge=purge)
