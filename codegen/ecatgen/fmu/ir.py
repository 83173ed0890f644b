"""The contents of an FMU. All decisions are made here; templates only write files from them.

A `str` is plain: the templates escape it for XML, HTML and the table. `Code` is written as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..text import Code

Attributes = tuple[tuple[str, str], ...]
"""Names and values of XML attributes, in the order in which they are written."""


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit definition.

    Attributes:
        name: Name of the unit.
        base: Attributes of the element BaseUnit; empty if the unit is unknown.
    """

    name: str
    base: Attributes


@dataclass(frozen=True, slots=True)
class Item:
    """A value of an enumeration."""

    name: str
    value: int
    description: str


@dataclass(frozen=True, slots=True)
class Enumeration:
    """An enumeration."""

    name: str
    description: str
    items: tuple[Item, ...]


@dataclass(frozen=True, slots=True)
class Category:
    """A category of messages."""

    name: str
    description: str


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable.

    Attributes:
        reference: Value reference, which is its place in the list of variables.
        name: Structured name.
        description: Description for the user.
        causality: `parameter`, `input`, `output` or `independent`, seen from the FMU.
        element: Name of the XML element of its type.
        attributes: Attributes of the variable.
        type_attributes: Attributes that belong to its type.
        start_texts: Start value of a text or of bytes in FMI 3.0, which is a separate element.
        unit: Unit, or empty.
        kind: Type for the documentation, as FMI calls it.
        limits: Smallest and largest value for the documentation, or empty.
        row: The line of the variable in `resources/plant.txt`.
    """

    reference: int
    name: str
    description: str
    causality: str
    element: Code
    attributes: Attributes
    type_attributes: Attributes
    start_texts: tuple[str, ...]
    unit: str
    kind: str
    limits: str
    row: Code


@dataclass(frozen=True, slots=True)
class Slave:
    """A slave that the bus must have.

    Attributes:
        instance: Prefix of the names of its variables.
        position: Position on the bus.
        vendor: Vendor ID.
        product: Product code.
        revision: Revision number.
        given_name: Name that the slave must have in the configuration; empty for no name.
        label: Name of the slave in messages.
        variables: Names of its variables, each with and without the prefix.
    """

    instance: str
    position: int
    vendor: int
    product: int
    revision: int
    given_name: str
    label: str
    variables: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class BusTerminal:
    """A bus terminal of FMI-LS-BUS, for one virtual ECU.

    Attributes:
        name: Name of the terminal, and prefix of its variables.
        variables: Names of its variables, each with and without the prefix.
        settings: The same for its configuration.
    """

    name: str
    variables: tuple[tuple[str, str], ...]
    settings: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class Unknown:
    """An element of the model structure.

    Attributes:
        number: Index (FMI 2.0, 1 first) or value reference (FMI 3.0) of the variable.
        dependencies: The variables on which its initial value depends, in the same form; None if it
            has no value then, or a constant one.
        clock: The variable on which it depends later; empty for none.
    """

    number: int
    dependencies: str | None
    clock: str = ""


@dataclass(frozen=True, slots=True)
class Fmu:
    """An FMU.

    Attributes:
        fmi: Major version of FMI: 2 or 3.
        name: Name of the model and its identifier.
        description: Description of the model.
        token: GUID (FMI 2.0) or instantiation token (FMI 3.0); empty until everything else is
            known.
        tool: Program that made the FMU, with its version.
        bus: Name of the bus.
        fingerprint: Fingerprint of the bus, 16 hex digits.
        command: Command that makes the FMU again.
        step_size: Bus cycle in seconds.
        unit_groups: The units of the variables as one group; empty if no variable has a unit.
        enumerations: Enumerations that are types of variables.
        categories: Categories of messages.
        variables: Variables by value reference.
        slaves: Slaves by position.
        messages: The lines of CAN messages in `resources/plant.txt`.
        drives: Those of drives.
        bus_terminals: Bus terminals of FMI-LS-BUS; with them, the FMU has events and clocks.
        unknowns: The outputs, as elements of the model structure.
        sources: C files to compile, relative to `sources`.
    """

    fmi: int
    name: str
    description: str
    token: str
    tool: str
    bus: str
    fingerprint: Code
    command: str
    step_size: str
    unit_groups: tuple[tuple[Unit, ...], ...]
    enumerations: tuple[Enumeration, ...]
    categories: tuple[Category, ...]
    variables: tuple[Variable, ...]
    slaves: tuple[Slave, ...]
    messages: tuple[Code, ...]
    drives: tuple[Code, ...]
    bus_terminals: tuple[BusTerminal, ...]
    unknowns: tuple[Unknown, ...]
    sources: tuple[str, ...]
