"""Parses the parts of a Modelica file that the drawing needs: classes, elements and annotations.

Equations and algorithms are skipped, except `connect` and `annotation`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from .expressions import Call, Expression, ExpressionParser, call
from .tokens import tokenize

_CLASS = frozenset(
    {"model", "class", "block", "connector", "package", "record", "type", "function"}
    | {"operator", "expandable"}
)
_CLASS_PREFIX = frozenset({"partial", "encapsulated", "impure", "pure"})
_ELEMENT_PREFIX = frozenset({"final", "inner", "outer", "replaceable", "redeclare"})
_COMPONENT_PREFIX = frozenset(
    {"flow", "stream", "discrete", "parameter", "constant", "input", "output", "each", "final"}
)
_SECTIONS = frozenset({"equation", "algorithm"})
_COMPOUND = frozenset({"if", "for", "when", "while"})


@dataclass(slots=True)
class Component:
    """A component of a class.

    Attributes:
        name: Its name.
        class_name: Class as written.
        modification: Modifiers and binding.
        condition: Condition of the component, None if it always exists.
        annotation: Its annotation.
        prefixes: Words such as `parameter` and `inner`.
        public: Whether it is declared in a public section.
    """

    name: str
    class_name: str
    modification: Call
    condition: Expression | None
    annotation: Call
    prefixes: frozenset[str]
    public: bool


@dataclass(slots=True)
class Extends:
    """An extends clause: base class and modifiers."""

    class_name: str
    modification: Call
    annotation: Call


@dataclass(slots=True)
class Connect:
    """A connect equation: two connectors as written, and the annotation."""

    a: str
    b: str
    annotation: Call


@dataclass(slots=True)
class Class:
    """A class definition.

    Attributes:
        name: Its name.
        kind: Its restriction: `block`, `connector`, ...
        description: Its description string.
        elements: Components in their order.
        bases: Base classes; a short class has one.
        classes: Inner classes, by name.
        imports: Full name of each imported class, by its short name.
        connects: Its connect equations.
        annotation: Its annotation.
        literals: Literals of an enumeration.
        prefixes: Words before its restriction, such as `partial`.
    """

    name: str
    kind: str
    description: str = ""
    elements: list[Component] = field(default_factory=list)
    bases: list[Extends] = field(default_factory=list)
    classes: dict[str, Class] = field(default_factory=dict)
    imports: dict[str, str] = field(default_factory=dict)
    connects: list[Connect] = field(default_factory=list)
    annotation: Call = field(default_factory=call)
    literals: tuple[str, ...] = ()
    prefixes: frozenset[str] = frozenset()


def parse(source: str) -> Class:
    """Returns the class that a file defines.

    Raises:
        ModelicaSyntaxError: The text is not a class, or has syntax that the drawing does not know.
    """
    return _Parser(source).file()


class _Parser(ExpressionParser):
    def __init__(self, source: str) -> None:
        super().__init__(source, tokenize(source))

    def file(self) -> Class:
        if self.take("within"):
            while not self.take(";"):
                self.next()
        self.take("final")
        result = self.class_definition()
        self.expect(";")
        return result

    def at_class(self) -> bool:
        at = 0
        while self.peek(at).text in _CLASS_PREFIX:
            at += 1
        return self.peek(at).text in _CLASS

    def class_definition(self) -> Class:
        prefixes = self.words(_CLASS_PREFIX)
        kind = self.next().text
        while self.peek().text in _CLASS:  # "expandable connector", "operator record"
            kind = self.next().text
        if self.take("extends"):
            raise self.error("class extends is not supported")
        result = Class(self.name(), kind, prefixes=prefixes)
        if self.take("="):
            self.short_class(result)
            return result
        result.description = self.description()
        self.composition(result)
        self.expect("end")
        self.name()
        return result

    def short_class(self, result: Class) -> None:
        self.words(_COMPONENT_PREFIX)
        if self.take("enumeration"):
            self.expect("(")
            literals = []
            while not self.take(")"):
                if not self.take(":"):
                    literals.append(self.name())
                    self.description()
                    self.annotation()
                self.take(",")
            result.literals = tuple(literals)
        else:
            base = self.dotted_name()
            self.subscripts()
            result.bases.append(Extends(base, self.modification(), call()))
        result.description = self.description()
        result.annotation = self.annotation()

    def composition(self, result: Class) -> None:
        public = True
        while self.peek().text != "end":
            token = self.peek()
            if token.text in ("public", "protected"):
                public = self.next().text == "public"
            elif token.text in _SECTIONS or (
                token.text == "initial" and self.peek(1).text in _SECTIONS
            ):
                self.section(result)
            elif token.text == "annotation":
                result.annotation = self.annotation()
                self.expect(";")
            elif token.text == "external":
                self.skip_statement()
            else:
                self.element(result, public)
                self.expect(";")

    def element(self, result: Class, public: bool) -> None:
        if self.take("import"):
            self.import_clause(result)
        elif self.take("extends"):
            base = self.dotted_name()
            result.bases.append(Extends(base, self.modification(), self.annotation()))
        else:
            prefixes = self.words(_ELEMENT_PREFIX)
            if self.at_class():
                inner = self.class_definition()
                result.classes[inner.name] = inner
            else:
                self.components(result, prefixes, public)
            if self.take("constrainedby"):
                self.dotted_name()
                self.modification()
                self.description()
                self.annotation()

    def import_clause(self, result: Class) -> None:
        first = self.dotted_name()
        if self.take("="):
            result.imports[first] = self.dotted_name()
        else:
            result.imports[first.rpartition(".")[2]] = first
        self.description()

    def components(self, result: Class, prefixes: frozenset[str], public: bool) -> None:
        prefixes |= self.words(_COMPONENT_PREFIX)
        class_name = self.dotted_name()
        self.subscripts()
        while True:
            name = self.name()
            self.subscripts()
            modification = self.modification()
            condition = self.expression() if self.take("if") else None
            self.description()
            annotation = self.annotation()
            result.elements.append(
                Component(name, class_name, modification, condition, annotation, prefixes, public)
            )
            if not self.take(","):
                return

    def section(self, result: Class) -> None:
        self.take("initial")
        self.next()
        end = {*_SECTIONS, "public", "protected", "initial"}
        while self.peek().text not in end and not self.at_end_of_class():
            if self.peek().text == "annotation":
                result.annotation = self.annotation()
                self.expect(";")
            elif self.take("connect"):
                self.expect("(")
                a = self.source(self.reference)
                self.expect(",")
                b = self.source(self.reference)
                self.expect(")")
                self.description()
                result.connects.append(Connect(a, b, self.annotation()))
                self.expect(";")
            else:
                self.skip_statement()

    def at_end_of_class(self) -> bool:
        return self.peek().text == "end" and self.peek(1).text not in _COMPOUND

    def skip_statement(self) -> None:
        """Skips a statement up to its semicolon, or the head of a compound statement."""
        compound = self.peek().text in {*_COMPOUND, "else", "elseif", "elsewhen"}
        while True:
            token = self.peek()
            if token.kind == "end":
                raise self.error("the text ends within an equation")
            self.next()
            if token.text in ("(", "[", "{") and token.kind == "symbol":
                self.skip_brackets()
            elif token.text == ";" or (compound and token.text in ("then", "loop", "else")):
                return
