"""Instances of classes: components with all their modifiers, and values of parameters."""

from __future__ import annotations

import operator as operators
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from .library import Found, Libraries
from .syntax import Array, Call, Component, Expression, Name, Operation

Value = float | bool | str | list[Any] | None
"""The value of an expression. A literal of an enumeration is a `Literal`; None means unknown."""


class Literal(str):
    """The name of a literal of an enumeration."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Element:
    """A component of an instance.

    Attributes:
        component: The declaration of the component.
        scope: Full name of the class that has the declaration.
        overrides: Modifiers of the extends clauses that inherit it, outermost first.
    """

    component: Component
    scope: str
    overrides: tuple[Call, ...]


class Instance:
    """A class with modifiers, as a component or on its own.

    Args:
        libraries: The libraries in which classes are looked up.
        found: The class.
        name: Name of the component.
        modification: Modifiers of the component.
        outer: The instance that has the component. Names in the modifiers refer to it.
    """

    def __init__(
        self,
        libraries: Libraries,
        found: Found,
        name: str,
        modification: Call | None = None,
        outer: Instance | None = None,
    ) -> None:
        self.found, self.name = found, name
        self._libraries, self._outer = libraries, outer
        self._modification = modification or Call()
        self._elements: dict[str, Element] | None = None
        self._active: set[str] = set()

    def layers(self) -> Iterator[tuple[Found, tuple[Call, ...]]]:
        """Yields the base classes, then the class, with the modifiers of their extends clauses."""
        yield from self._layers(self.found, ())

    def _layers(
        self, found: Found, overrides: tuple[Call, ...]
    ) -> Iterator[tuple[Found, tuple[Call, ...]]]:
        for base in found.definition.bases:
            parent = self._libraries.find(base.class_name, found.path)
            if parent is not None and parent.path != found.path:
                yield from self._layers(parent, (*overrides, base.modification))
        yield found, overrides

    @property
    def elements(self) -> dict[str, Element]:
        """Components, inherited ones included, by name."""
        if self._elements is None:
            self._elements = {
                component.name: Element(component, found.path, overrides)
                for found, overrides in self.layers()
                for component in found.definition.elements
            }
        return self._elements

    def component(self, element: Element) -> Instance | None:
        """Returns a component as an instance, None if its class is built in."""
        component = element.component
        found = self._libraries.find(component.class_name, element.scope)
        if found is None:
            return None
        merged = Call("", named=dict(component.modification.named))
        for override in reversed(element.overrides):
            merged.named.update(override.part(component.name).named)
        merged.named.update(self._modification.part(component.name).named)
        return Instance(self._libraries, found, component.name, merged, self)

    def exists(self, element: Element) -> bool:
        """Whether the condition of a component holds; True also if its value is unknown."""
        condition = element.component.condition
        return condition is None or self.value(condition) is not False

    def binding(self, name: str) -> tuple[Call, Instance] | None:
        """Returns the binding of a parameter, and the instance that its names refer to."""
        element = self.elements.get(name)
        if element is None:
            return None
        given = self._modification.part(name)
        if given.binding is not None and self._outer is not None:
            return given, self._outer
        for override in element.overrides:
            if override.part(name).binding is not None:
                return override.part(name), self
        own = element.component.modification
        return None if own.binding is None else (own, self)

    def text(self, name: str) -> str:
        """Returns the value of a parameter as icons show it."""
        bound = self.binding(name)
        if bound is None:
            return ""
        binding, scope = bound
        value = scope.value(binding.binding)
        if isinstance(value, Literal | str):
            return str(value)
        if isinstance(binding.binding, Name) and value is not None:
            return _shown(value)
        return binding.text

    def value(self, expression: Expression | None) -> Value:
        """Returns the value of an expression in this instance, None if it is unknown.

        Only the expressions that drawings need are supported.
        """
        match expression:
            case None | bool() | float() | str():
                return expression
            case Array(elements):
                return [self.value(element) for element in elements]
            case Name(text):
                return self._named(text)
            case Operation("if", (condition, yes, no)):
                decided = self.value(condition)
                return None if decided is None else self.value(yes if decided else no)
            case Operation(operator, operands):
                return _operation(operator, [self.value(operand) for operand in operands])
            case Call("DynamicSelect", arguments):
                return self.value(arguments[0])
            case _:
                return None

    def _named(self, name: str) -> Value:
        if name in self.elements:
            if name in self._active:
                return None
            self._active.add(name)
            bound = self.binding(name)
            value = None if bound is None else bound[1].value(bound[0].binding)
            self._active.remove(name)
            return value
        prefix, _, last = name.rpartition(".")
        if prefix and prefix.partition(".")[0] not in self.elements and _may_be_literal(last):
            return Literal(last)
        return None


def _may_be_literal(name: str) -> bool:
    return name[:1].isupper() or name.startswith("'")


def _shown(value: Value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


_FUNCTIONS: dict[tuple[str, int], Callable[..., Value]] = {
    ("-", 1): operators.neg,
    ("+", 1): operators.pos,
    ("not", 1): operators.not_,
    ("and", 2): lambda a, b: a and b,
    ("or", 2): lambda a, b: a or b,
    ("==", 2): operators.eq,
    ("<>", 2): operators.ne,
    ("<", 2): operators.lt,
    (">", 2): operators.gt,
    ("<=", 2): operators.le,
    (">=", 2): operators.ge,
    ("+", 2): operators.add,
    ("-", 2): operators.sub,
    ("*", 2): operators.mul,
    ("/", 2): operators.truediv,
}


def _operation(operator: str, values: list[Value]) -> Value:
    if None in values:
        if operator == "or" and True in values:
            return True
        return False if operator == "and" and False in values else None
    function = _FUNCTIONS.get((operator, len(values)))
    try:
        return None if function is None else function(*values)
    except (TypeError, ZeroDivisionError):
        return None
