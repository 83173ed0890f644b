"""The Modelica block of a recording: a table, and an output for each value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from jinja2 import PackageLoader

from .. import names, placement
from ..environment import CheckedEnvironment
from ..ir import Extent, Kind
from ..labels import label
from ..render import FILTERS
from ..text import Code, Language, code, identifier
from .variables import Variable, modelica_names


@dataclass(frozen=True, slots=True)
class RecordedBlock:
    """What the block is about.

    Attributes:
        name: Class name.
        table: Name of the file with the table, which is in the folder of the block.
        table_name: Name of the table in it.
        variables: Its columns behind the time.
        title: What was recorded, and when.
        reason: Why it was recorded, or empty.
        cycle_time: Seconds from one cycle to the next.
        duration: Seconds from the first cycle to the end of the last one.
        trigger: Seconds from the first cycle to what has begun the recording; None if nothing has.
        cycles: Number of cycles.
        missing: How many cycles in between are missing.
    """

    name: str
    table: str
    table_name: str
    variables: Sequence[Variable]
    title: str
    reason: str
    cycle_time: float
    duration: float
    trigger: float | None
    cycles: int
    missing: int


@dataclass(frozen=True, slots=True)
class _Output:
    name: Code
    kind: Kind
    class_name: Code
    modifiers: tuple[Code, ...]
    description: str
    unit: str
    column: int
    place: int  # in its table
    port: Extent
    label: str
    label_extent: Extent


@cache
def _environment() -> CheckedEnvironment:
    loader = PackageLoader("ecatgen.recorded", "templates")
    return CheckedEnvironment(loader, Language.DOCUMENTATION, FILTERS)


def render_block(recorded: RecordedBlock) -> str:
    """The text of the Modelica file.

    Raises:
        UsageError: A block cannot have this name.
    """
    name = names.library_name(recorded.name)
    labels = [label(item) for item in modelica_names(recorded.variables)]
    icon = placement.icon(name, [], labels)
    outputs = _outputs(recorded.variables, labels, icon)
    columns = {
        kind: [item.column for item in outputs if (item.kind == "Real") == (kind == "reals")]
        for kind in ("reals", "held")
    }
    lists = {kind: Code(", ").join(map(code, found)) for kind, found in columns.items()}
    template = _environment().get_template("block.mo.j2")
    return template.render(
        recorded=recorded,
        name=name,
        instance=identifier(names.instance_name(name)),
        outputs=outputs,
        columns=lists,
        icon=icon,
        rule=placement.rule(icon),
        title_extent=placement.title(icon),
        name_extent=placement.above(icon),
    )


def _outputs(variables: Sequence[Variable], labels: Sequence[str], icon: Extent) -> list[_Output]:
    found: list[_Output] = []
    places = {"reals": 0, "held": 0}
    for row, (item, name, text) in enumerate(
        zip(variables, modelica_names(variables), labels, strict=True)
    ):
        table = "reals" if item.kind == "Real" else "held"
        places[table] += 1
        found.append(
            _Output(
                name=name,
                kind=item.kind,
                class_name=Code("Modelica.Blocks.Interfaces.%sOutput") % identifier(item.kind),
                modifiers=item.modifiers,
                description=item.description,
                unit=item.unit,
                column=row + 2,
                place=places[table],
                port=placement.port(icon, row, left=False),
                label=text,
                label_extent=placement.port_label(icon, row, text, left=False),
            )
        )
    return found
