"""An incident of the flight recorder, for pages: values of cycles, and what ecatd knew then.

What is attached may be missing, damaged, or contradict the values: each part is told as far as it
makes sense, and what does not is told as the failure of that part.
"""

from __future__ import annotations

import json
import re
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from ecatd.base.errors import EcatError, StateError, UsageError
from ecatd.base.incident_file import CYCLE, IncidentFile
from ecatd.base.mcap_file import in_words
from ecatd.description.bus_reader import read_bus
from ecatd.operations.bus import ReadConfig, ReadInfo, ReadStates
from ecatd.operations.description import Describe
from ecatd.operations.health import look_at
from ecatd.operations.incident_files import read_head
from ecatd.operations.outputs import ReadOutputs
from ecatd.operations.registers import ReadErrors
from ecatd.operations.statistics import ReadStats
from ecatd.shm.statistics import from_map
from ecatd.view.lamps import Lamps
from ecatd.view.worst import describe_worst

from .hub import Hub
from .messages import WORST, encode
from .signals import describe_signals

READING = "reading"
"""The key of the first reading, which no query has: a map with `text`."""
_MOST = 32 << 20
"""Bytes of an attachment that is looked at."""
_TEXT_MOST = 1 << 16
_OUTPUTS = "outputs"
"""The lamp that needs to know who owns outputs, which an incident does not say."""
_SLAVE = re.compile(r"(?<![\d:.])(\d+) \((?!cycle |\d)")
"""A slave in a text, such as that of `slaves 5 (EL3008) and 6 (EL6751)`."""
_DEFAULTS: Mapping[str, Any] = {"minimum": None, "maximum": None, "values": {}}
_BY_FILE = ("slave", "address", "output", "type", "scale", "offset", "unit")
_BY_DESCRIPTION = ("label", "bits", "minimum", "maximum", "values")
_SEVERITIES = ("error", "warning", "notice", "info")


class RecordedIncident:
    """See `ecatd.web.file_source.Contents`.

    Args:
        file: The file.

    Raises:
        UsageError: It is damaged.
    """

    def __init__(self, file: IncidentFile) -> None:
        self._file = file
        self._at, self.about = self._head()
        self.answers: dict[str, Mapping[str, Any] | EcatError] = {
            key: self._value(name, check)
            for key, (name, check) in {
                Describe.key: ("bus.json", lambda it: read_bus(it, "bus.json", strict=False)),
                ReadStates.key: ("states.json", look_at),
                ReadStats.key: ("statistics.json", from_map),
                ReadInfo.key: ("info.json", dict),
                ReadConfig.key: ("configuration.json", dict),
            }.items()
        }
        for key, what in (
            (ReadOutputs.key, "who owned outputs"),
            (ReadErrors.key, "error counters"),
        ):
            self.answers[key] = StateError(f"an incident does not have {what}")
        if isinstance(config := self.answers[ReadConfig.key], Mapping):
            self.answers[ReadConfig.key] = {"config": config, "origins": {}}
        try:
            text = self._attachment("reading.txt").decode(errors="replace")[:_TEXT_MOST]
            self.answers[READING] = {"text": text}
        except EcatError as error:
            self.answers[READING] = error
        self._events, self._bad_events = self._read_events()
        self.signals, self.columns = self._describe()
        self.named = self._named()

    def _named(self) -> list[str]:
        """The signals that the trigger or the reading names, or those of the slaves there."""
        answer = self.answers[READING]
        for text in (self.about, answer["text"] if isinstance(answer, Mapping) else ""):
            slaves = {int(found) for found in _SLAVE.findall(text)}
            for found in (
                [it["name"] for it in self.signals if it["path"] in text],
                [it["name"] for it in self.signals if it["slave"] in slaves],
            ):
                if found:
                    return found
        return []

    def _head(self) -> tuple[float, str]:
        """Unix time of the trigger in seconds, and what the file is about."""
        try:
            facts = read_head(self._file.path)
            seconds = int(facts["time_ns"]) / 1e9
            moment = time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime(seconds))
            reason = facts["reason"]
        except (OSError, OverflowError, KeyError, ValueError) as error:
            text = f"{self._file.path} is a damaged incident{in_words(error)}; copy it again"
            raise UsageError(text) from error
        about = f"an incident of bus '{self._file.bus}' at {moment} UTC: {reason}"
        if damage := self._file.damage():
            about += f". {damage}"
        return seconds, about

    def _attachment(self, name: str) -> bytes:
        if self._file.sizes.get(name, 0) > _MOST:
            raise UsageError(f"{name} of the incident is too large to be shown here")
        try:
            return self._file.attachment(name)
        except (OSError, ValueError) as error:
            raise StateError(f"the incident has no {name} that can be read: {error}") from error

    def _document(self, name: str) -> Any:
        data = self._attachment(name)
        try:
            found = json.loads(data)
            encode({"": found})
        except (RecursionError, ValueError) as error:
            raise UsageError(f"{name} of the incident is damaged{in_words(error)}") from error
        return found

    def _value(self, name: str, check: Callable[[Any], object]) -> Mapping[str, Any] | EcatError:
        """A document that makes sense to `check`, or why there is none."""
        try:
            found = self._document(name)
            if not isinstance(found, dict):
                raise UsageError(f"{name} of the incident is no map")
            check(found)
        except EcatError as error:
            return error
        except (AttributeError, LookupError, OverflowError, TypeError, ValueError) as error:
            return UsageError(f"{name} of the incident makes no sense{in_words(error)}")
        return found

    def _read_events(self) -> tuple[list[Mapping[str, Any]], int]:
        """The events, and how many make no sense."""
        try:
            found = self._document("events.json")
        except EcatError:
            return [], 1
        good = [event for event in found if _is_event(event)] if isinstance(found, list) else []
        return good, len(found) - len(good) if isinstance(found, list) else 1

    def _describe(self) -> tuple[list[Mapping[str, Any]], dict[str, str]]:
        """The signals, and by their names the fields with their raw values."""
        known: defaultdict[tuple[int, str, bool, str], list[Mapping[str, Any]]] = defaultdict(list)
        description = self.answers[Describe.key]
        if isinstance(description, Mapping):
            bus = read_bus(description, "bus.json", strict=False)
            for item in describe_signals(bus):
                known[_identity(item)].append(item)
        signals: dict[str, Mapping[str, Any]] = {}
        columns: dict[str, str] = {}
        for item in self._file.signals:
            name, number = f"{item['slave']}/{item['address']}", 1
            while name in signals:
                number += 1
                name = f"{item['slave']}/{item['address']} ({number})"
            same = known[_identity(item)]
            described = same.pop(0) if same else {}
            # What the values mean is said beside them; names come from the description.
            signals[name] = {
                **_DEFAULTS,
                "label": item["name"],
                "path": item["name"],
                "bits": _bits(item["type"]),
                **{key: described[key] for key in _BY_DESCRIPTION if key in described},
                **{key: item[key] for key in _BY_FILE},
                "name": name,
            }
            columns[name] = item["raw"]
        return [*signals.values()], columns

    def cycles(self) -> Iterator[tuple[int, int, Mapping[str, Any]]]:
        """See `Contents`."""
        try:
            for time_ns, values in self._file.cycles():
                number = values[CYCLE]
                if number is None:
                    raise ValueError(f"{self._file.path} is damaged: a cycle has no number")
                yield time_ns, int(number), values
        except OSError as error:
            raise UsageError(f"cannot read '{self._file.path}': {error.strerror}") from error
        except ValueError as error:
            raise UsageError(str(error)) from error

    def tell(self, hub: Hub) -> None:
        """See `Contents`."""
        for key, value in self.answers.items():
            hub.value(key, value, self._at)
        found = [self.answers[key] for key in (ReadStats.key, ReadStates.key)]
        statistics, states = (item if isinstance(item, Mapping) else None for item in found)
        if statistics is not None:
            hub.value(WORST, describe_worst(statistics, self._events, self._at), self._at)
        lamps = Lamps().look(statistics, states, None, self._at)
        hub.lamps((lamp for lamp in lamps if lamp["id"] != _OUTPUTS), self._at)
        hub.events(self._events, self._bad_events)


def _identity(signal: Mapping[str, Any]) -> tuple[int, str, bool, str]:
    return signal["slave"], signal["address"], signal["output"], signal["type"]


def _bits(kind: str) -> int:
    return int("".join(letter for letter in kind if letter.isdigit()))


def _is_event(event: Any) -> bool:
    return (
        isinstance(event, dict)
        and all(isinstance(event.get(key), str) for key in ("event", "text"))
        and all(type(event.get(key)) is int for key in ("sequence", "time_ns"))
        and event.get("severity") in _SEVERITIES
    )
