"""Collects everything that the icon or the diagram of a class shows."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from .geometry import Box, Point, Transform, box_of, moved, placed
from .instances import Element, Instance
from .library import Libraries
from .shapes import Item, Style, draw, line
from .syntax import Array, Call, Class

_DEFAULT_SYSTEM = Box(-100, -100, 100, 100)


@dataclass(slots=True)
class Part:
    """A component in a picture, with the shapes that are drawn for it.

    Attributes:
        name: Name of the component.
        path: Full name of its class.
        connector: Whether it is a connector.
        box: The extent of its placement.
        items: The shapes and labels of its icon.
        parts: Connectors in its icon, by name.
    """

    name: str
    path: str
    connector: bool
    box: Box
    items: list[Item] = field(default_factory=list)
    parts: dict[str, Part] = field(default_factory=dict)


@dataclass(slots=True)
class ConnectLine:
    """A connection: its two connectors as written, and its line."""

    a: str
    b: str
    points: list[Point]
    items: list[Item]


@dataclass(slots=True)
class Scene:
    """A picture of a class.

    Attributes:
        path: Full name of the class.
        description: Its description.
        box: The extent of its coordinate system.
        items: Its own primitives, at the back.
        parts: Its components, by name.
        lines: Its connections.
    """

    path: str
    description: str
    box: Box
    items: list[Item]
    parts: dict[str, Part]
    lines: list[ConnectLine] = field(default_factory=list)


def icon(
    libraries: Libraries,
    path: str,
    name: str | None = None,
    to: Transform | None = None,
    modification: Call | None = None,
) -> Scene:
    """Returns the icon of a class.

    Args:
        libraries: The libraries in which classes are looked up.
        path: Full name of the class.
        name: Name of the component in the icon; by default that of a new component in an editor.
        to: Transformation of the icon, by default none.
        modification: Modifiers of the component.

    Raises:
        NoSuchClassError: A class is missing.
        ModelicaSyntaxError: A class cannot be read.
    """
    found = libraries.get(path)
    instance = Instance(libraries, found, name or _usual_name(found.definition), modification)
    to = to or Transform()
    part = _icon(instance, to, connector=False)
    return Scene(path, found.definition.description, part.box, part.items, part.parts)


def diagram(libraries: Libraries, path: str) -> Scene:
    """Returns the diagram of a class.

    Raises:
        NoSuchClassError: A class is missing.
        ModelicaSyntaxError: A class cannot be read.
    """
    found = libraries.get(path)
    instance = Instance(libraries, found, path.rpartition(".")[2])
    system, _ = _system(instance, "Diagram")
    scene = Scene(path, found.definition.description, system, [], {})
    scene.items.extend(_graphics(instance, "Diagram", Transform()))
    for element, component in _components(instance):
        place = _placement(instance, element, "transformation")
        if place is not None:
            layer = "Diagram" if _is_connector(component) else "Icon"
            scene.parts[component.name] = _component(component, place, Transform(), layer)
    for layer_found, _ in instance.layers():
        for connect in layer_found.definition.connects:
            if not (_is_there(instance, connect.a) and _is_there(instance, connect.b)):
                continue
            style = Style(connect.annotation.part("Line"), instance)
            scene.lines.append(
                ConnectLine(
                    connect.a, connect.b, style.points("points"), list(line(style, Transform()))
                )
            )
    return scene


def _usual_name(definition: Class) -> str:
    given = definition.annotation.named.get("defaultComponentName")
    return str(given.binding) if given is not None else definition.name.lower()


def _components(instance: Instance) -> Iterator[tuple[Element, Instance]]:
    """Yields the components that have a `Placement`, and whose condition holds."""
    for element in instance.elements.values():
        if "Placement" in element.component.annotation.named and instance.exists(element):
            component = instance.component(element)
            if component is not None:
                yield element, component


def _is_there(instance: Instance, connector: str) -> bool:
    """Whether a connector exists: its own condition holds, and that of its component does, too."""
    at: Instance | None = instance
    for name in re.sub(r"\[[^]]*\]", "", connector).split("."):
        element = None if at is None else at.elements.get(name)
        if at is None or element is None:
            return True  # unknown: the check of the diagram reports it
        if not at.exists(element):
            return False
        at = at.component(element)
    return True


def _is_connector(instance: Instance) -> bool:
    return any("connector" in found.definition.kind for found, _ in instance.layers())


@dataclass(frozen=True, slots=True)
class _Place:
    a: Point
    b: Point
    origin: Point
    rotation: float


def _placement(instance: Instance, element: Element, kind: str) -> _Place | None:
    placement = element.component.annotation.part("Placement")
    transformation = placement.part(kind)
    if "extent" not in transformation.named:
        transformation = placement.part("transformation")
    if Style(placement, instance).value("visible", True) is False:
        return None
    style = Style(transformation, instance)
    points = style.points("extent")
    if len(points) != 2:
        return None
    return _Place(points[0], points[1], style.point("origin"), style.number("rotation", 0))


def _component(component: Instance, place: _Place, to: Transform, layer: str) -> Part:
    if layer == "Diagram" and not any(_graphics(component, "Diagram", Transform())):
        layer = "Icon"
    system, keep_ratio = _system(component, layer)
    to = to.after(moved(place.origin, place.rotation))
    inner = to.after(placed(system, place.a, place.b, keep_ratio=keep_ratio))
    connector = _is_connector(component)
    part = _icon(component, inner, connector=connector, layer=layer)
    part.box = to.box(box_of((place.a, place.b)))
    return part


def _icon(instance: Instance, to: Transform, *, connector: bool, layer: str = "Icon") -> Part:
    system, _ = _system(instance, layer)
    part = Part(instance.name, instance.found.path, connector, to.box(system))
    part.items.extend(_graphics(instance, layer, to))
    if not connector:
        for element, component in _components(instance):
            if element.component.public and _is_connector(component):
                place = _placement(instance, element, "iconTransformation")
                if place is not None:
                    part.parts[component.name] = _component(component, place, to, "Icon")
    return part


def drag_scale(libraries: Libraries, path: str) -> float:
    """Returns the scale of the icon in a diagram after an editor has put the class there."""
    instance = Instance(libraries, libraries.get(path), "")
    style = _coordinate_system(instance, "Icon")
    return 0.1 if style is None else style.number("initialScale", 0.1)


def _system(instance: Instance, layer: str) -> tuple[Box, bool]:
    """Returns the extent of the coordinate system, and whether it keeps its aspect ratio."""
    style = _coordinate_system(instance, layer)
    if style is None:
        return _DEFAULT_SYSTEM, True
    return box_of(style.points("extent")), style.value("preserveAspectRatio", True) is not False


def _coordinate_system(instance: Instance, layer: str) -> Style | None:
    """Returns the coordinate system of the class, or of the first base class that has one."""
    layers = [found for found, _ in instance.layers()]
    for found in (layers[-1], *layers[:-1]):
        style = Style(found.definition.annotation.part(layer).part("coordinateSystem"), instance)
        if style.points("extent"):
            return style
    return None


def _graphics(instance: Instance, layer: str, to: Transform) -> Iterator[Item]:
    for found, _ in instance.layers():
        graphics = found.definition.annotation.part(layer).named.get("graphics")
        if graphics is not None and isinstance(graphics.binding, Array):
            for primitive in graphics.binding.elements:
                if isinstance(primitive, Call):
                    yield from draw(primitive, instance, to)
