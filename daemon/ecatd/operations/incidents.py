"""Operations about incidents: files of the flight recorder.

An incident has frames, so who reads one needs the right to read frames. Who may only read gets the
list.
"""

from __future__ import annotations

from .fields import ClientName, Count
from .operation import Map, Operation
from .registers import Data

NO_RECORDER = (
    "ecatd records no incidents, because flight_recorder.folder of the configuration is empty: "
    'write a folder there, such as "/var/lib/ecatd/ecat0"'
)


class Incident(Map):
    """An incident."""

    name: str  #: Name of its file.
    bytes: int  #: Size of the file.
    time_ns: int  #: Unix time of the trigger in ns.
    trigger: str  #: Kind of the trigger: `fault`, `lapse`, `condition` or `request`.
    reason: str  #: What has happened, in a sentence.
    cause: str  #: What the first reading says was the cause; empty if it knows none.
    cycles: int  #: Cycles that it has.
    seconds: float  #: From its first cycle to its last one.
    missing: int  #: Cycles in between that are missing.


class IncidentList(Map):
    """The incidents of a bus."""

    folder: str  #: Where their files are on the machine of the bus.
    incidents: list[Incident]  #: Those, the oldest first.


class ListIncidents(Operation[IncidentList]):
    """Asks for the incidents that are kept."""

    op = "list_incidents"
    key = "ro/incidents"


class IncidentRequested(Map):
    """An incident that was asked for."""

    time_ns: int  #: Unix time of the trigger, which the list shows with the incident.


class RecordIncident(Operation[IncidentRequested]):
    """Asks for an incident of now. It is in the list when it has been written."""

    op = "record_incident"
    key = "rw/incident/record"
    reason: ClientName = ""  #: Why, for the incident.
    by: ClientName = ""  #: The name that the client gives itself, for the log.


class DeleteIncident(Operation[IncidentList]):
    """Deletes an incident; the answer has those that are left."""

    op = "delete_incident"
    key = "rw/incident/delete"
    name: ClientName  #: Name of its file.
    by: ClientName = ""  #: The name that the client gives itself, for the log.


class ReadIncident(Operation[Data]):
    """Asks for a part of an incident: its bytes from an offset on; none behind its end."""

    op = "read_incident"
    key = "rw/frames/incident/{name}/{offset}"
    is_repeatable = True
    name: ClientName  #: Name of its file.
    offset: Count = 0  #: Where the part begins.
