"""Decodes XML files, in whatever encoding they are.

The byte order mark decides, else the encoding that the file declares, with Python's codecs. Where a
vendor's tool writes more characters than the declared encoding has (GB2312 and GBK, Shift_JIS and
Windows-31J), the larger one is used. Bytes that do not fit are told, and are read as UTF-8 if all
of the file is UTF-8, else as Windows-1252.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Callable, Iterator
from pathlib import Path

_CHUNK = 1 << 16
_HEAD = 1024
_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
_WIDE = (
    (b"<\0\0\0", "utf-32-le"),
    (b"\0\0\0<", "utf-32-be"),
    (b"<\0", "utf-16-le"),
    (b"\0<", "utf-16-be"),
)
_DECLARED = re.compile(rb"""\s*<\?xml[^>]*?\sencoding\s*=\s*["']\s*([^"'>]{1,40}?)\s*["']""")
_LARGER = {
    "ascii": "cp1252",
    "iso8859-1": "cp1252",
    "iso8859-9": "cp1254",
    "gb2312": "gb18030",
    "gbk": "gb18030",
    "big5": "cp950",
    "shift_jis": "cp932",
    "euc_kr": "cp949",
}
"""Encodings that real files exceed, and the larger ones that they mean."""

_OTHER_NAMES = {"windows-31j": "cp932", "gb_2312-80": "gb2312", "windows-936": "gbk"}
_FALLBACKS = ("utf-8", "cp1252", "latin-1")
_NAMES = {"utf-8": "UTF-8", "cp1252": "Windows-1252", "latin-1": "ISO 8859-1"}
_CONTROL = re.compile("[\0-\x08\x0b\x0c\x0e-\x1f\ufdd0-\ufdef\ufffe\uffff]")
_PRINTABLE = bytes(range(0x20, 0x7F))

Tell = Callable[[int, str, str], None]
"""Takes what is wrong in a file: line, text, and how it is used."""


class XmlText:
    """The text of an XML file.

    Args:
        path: The file.
        tell: Called with each deviation.

    Attributes:
        first_line: Line of the first character that is not white space, less 1: XML allows nothing
            before its declaration.
    """

    def __init__(self, path: Path, tell: Tell) -> None:
        self._path, self._tell = path, tell
        self.first_line = 0

    def chunks(self) -> Iterator[str]:
        """The text in parts, without white space in front and without control characters.

        Raises:
            OSError: The file cannot be read.
        """
        encoding, mark = self._encoding()
        decoder = codecs.getincrementaldecoder(encoding)()
        begun, line = False, 1
        with self._path.open("rb") as file:
            file.seek(mark)
            while True:
                data = file.read(_CHUNK)
                text = decoder.decode(data, final=not data)
                clean = _CONTROL.sub("", text)
                if clean != text:
                    at = line + text.count("\n", 0, _first_control(text))
                    self._tell(at, "there are control characters", "they are left out")
                line += text.count("\n")
                if not begun:
                    stripped = clean.lstrip("\ufeff \t\r\n")
                    self.first_line += clean.count("\n", 0, len(clean) - len(stripped))
                    clean, begun = stripped, bool(stripped)
                if clean:
                    yield clean
                if not data:
                    return

    def _encoding(self) -> tuple[str, int]:
        """Finds the encoding, and the length of the byte order mark."""
        with self._path.open("rb") as file:
            head = file.read(_HEAD)
        for mark, encoding in _MARKS:
            if head.startswith(mark):
                return self._first_fitting([encoding, *_FALLBACKS], encoding, len(mark)), len(mark)
        for begin, encoding in _WIDE:
            if head.startswith(begin):
                return self._first_fitting([encoding, *_FALLBACKS], encoding, 0), 0
        match = _DECLARED.match(head)
        declared = match[1].decode("latin-1") if match else "UTF-8"
        known = _known(declared)
        if known is None:
            text = f"the encoding '{declared}' is unknown, or not that of the file"
            fitting = self._first_fitting(list(_FALLBACKS), "", 0)
            self._tell(1, text, f"it is read as {_NAMES[fitting]}, so some names may be wrong")
            return fitting, 0
        larger = _LARGER.get(known, known)
        return self._first_fitting([larger, known, *_FALLBACKS], declared, 0), 0

    def _first_fitting(self, candidates: list[str], declared: str, mark: int) -> str:
        """The first encoding that fits all of the file; tells if it is not the declared one."""
        line = 0
        for number, encoding in enumerate(dict.fromkeys(candidates)):
            wrong = self._first_wrong_line(encoding, mark)
            if not wrong:
                if line and declared and encoding in _NAMES and number:
                    text = f"the file has bytes that are not {declared}"
                    effect = f"it is read as {_NAMES[encoding]}, so some names may be wrong"
                    self._tell(line, text, effect)
                return encoding
            line = line or wrong
        raise AssertionError("each byte is a character of ISO 8859-1")

    def _first_wrong_line(self, encoding: str, mark: int) -> int:
        """The first line that is not in this encoding; 0 if all are."""
        decoder = codecs.getincrementaldecoder(encoding)()
        line = 1
        with self._path.open("rb") as file:
            file.seek(mark)
            while True:
                data = file.read(_CHUNK)
                try:
                    decoder.decode(data, final=not data)
                except UnicodeDecodeError as error:
                    return line + data.count(b"\n", 0, error.start)
                if not data:
                    return 0
                line += data.count(b"\n")


def _known(name: str) -> str | None:
    """Python's name of an encoding in which the letters of ASCII are what they are; else None."""
    name = _OTHER_NAMES.get(name.lower(), name.lower().removeprefix("x-"))
    try:
        text = _PRINTABLE.decode(name)
        encoding = codecs.lookup(name).name
        codecs.getincrementaldecoder(encoding)
    except (LookupError, ValueError):
        return None
    return encoding if text == _PRINTABLE.decode("ascii") else None


def _first_control(text: str) -> int:
    match = _CONTROL.search(text)
    return match.start() if match else 0
