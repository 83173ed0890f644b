"""Parses Modelica expressions and modifications, of which annotations consist, too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from .tokens import ModelicaSyntaxError, Token

_BINARY = (
    ("or",),
    ("and",),
    ("<", "<=", ">", ">=", "==", "<>"),
    ("+", "-", ".+", ".-"),
    ("*", "/", ".*", "./"),
    ("^", ".^"),
)


@dataclass(frozen=True, slots=True)
class Name:
    """A dotted name, without subscripts."""

    text: str


@dataclass(frozen=True, slots=True)
class Operation:
    """An operator, `if`, or `:` with its operands."""

    operator: str
    operands: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class Array:
    """An array with its elements."""

    elements: tuple[Expression, ...]


@dataclass(slots=True)
class Call:
    """A function call, or a modification: `name(arguments, key = value, ...) = binding`.

    Attributes:
        name: Name of the function or of the modified element.
        arguments: Positional arguments.
        named: Arguments by name; in a modification also `Call`s, by the name of the modified
            element.
        binding: Value after `=`.
        text: Source text of the binding.
    """

    name: str
    arguments: list[Expression] = field(default_factory=list)
    named: dict[str, Any] = field(default_factory=dict)
    binding: Any = None
    text: str = ""

    def part(self, name: str) -> Call:
        """Returns the modification of an element, or an empty one if there is none."""
        found = self.named.get(name)
        return found if isinstance(found, Call) else call(name)


Expression = float | str | bool | Name | Operation | Array | Call


def call(name: str = "") -> Call:
    """Returns an empty call."""
    return Call(name)


class ExpressionParser:
    """The part of the parser for expressions.

    A method that takes something moves on to the token after it. Methods that take a part of the
    syntax raise `ModelicaSyntaxError` if the text does not fit.

    Args:
        source: The source text.
        tokens: Its tokens.
    """

    def __init__(self, source: str, tokens: list[Token]) -> None:
        self._source = source
        self._tokens = tokens
        self._at = 0

    def peek(self, ahead: int = 0) -> Token:
        """Returns the next token, or one further ahead, without taking it."""
        return self._tokens[min(self._at + ahead, len(self._tokens) - 1)]

    def next(self) -> Token:
        """Takes the next token."""
        token = self.peek()
        self._at += 1
        return token

    def take(self, text: str) -> bool:
        """Takes the next token if it is this word or symbol, and returns whether it was."""
        token = self.peek()
        if token.text != text or token.kind == "string":
            return False
        self._at += 1
        return True

    def expect(self, text: str) -> None:
        """Takes this word or symbol."""
        if not self.take(text):
            raise self.error(f"{text!r} is expected before {self.peek().text!r}")

    def error(self, what: str) -> ModelicaSyntaxError:
        """Returns an error at the next token."""
        line = self._source.count("\n", 0, self.peek().start) + 1
        return ModelicaSyntaxError(f"line {line}: {what}")

    def words(self, words: frozenset[str]) -> frozenset[str]:
        """Takes the next tokens as long as they are among these words."""
        found = set()
        while self.peek().text in words and self.peek().kind == "name":
            found.add(self.next().text)
        return frozenset(found)

    def name(self) -> str:
        """Takes an identifier."""
        if self.peek().kind != "name":
            raise self.error(f"a name is expected before {self.peek().text!r}")
        return self.next().text

    def dotted_name(self) -> str:
        """Takes a name with dots; a dot before it means that it is a full name."""
        text = "." if self.take(".") else ""
        text += self.name()
        while self.peek().text == "." and self.peek(1).kind == "name":
            self.next()
            text += f".{self.next().text}"
        return text

    def reference(self) -> Name:
        """Takes the name of a component, and drops its subscripts."""
        text = self.name()
        self.subscripts()
        while self.take("."):
            text += f".{self.name()}"
            self.subscripts()
        return Name(text)

    def subscripts(self) -> None:
        """Skips subscripts."""
        if self.take("["):
            self.skip_brackets()

    def skip_brackets(self) -> None:
        """Skips to the bracket that closes the one just taken."""
        depth = 1
        while depth:
            token = self.next()
            if token.kind == "end":
                raise self.error("a bracket is not closed")
            if token.kind == "symbol":
                depth += (token.text in "([{") - (token.text in ")]}")

    def source(self, rule: Callable[[], object]) -> str:
        """Applies a rule of the parser, and returns the source text that it has taken."""
        start = self.peek().start
        rule()
        return self._source[start : self._tokens[self._at - 1].stop]

    def description(self) -> str:
        """Takes a description string, or nothing."""
        text = ""
        while self.peek().kind == "string":
            text += self.next().text
            self.take("+")
        return text

    def annotation(self) -> Call:
        """Takes an annotation, or nothing."""
        return self.modification() if self.take("annotation") else call()

    def modification(self) -> Call:
        """Takes modifiers and a binding, or nothing."""
        result = call()
        if self.take("("):
            self.arguments(result)
        if self.take("=") or self.take(":="):
            start = self.peek().start
            result.binding = self.expression()
            result.text = self._source[start : self._tokens[self._at - 1].stop]
        return result

    def arguments(self, result: Call) -> None:
        """Takes arguments up to the closing bracket, and adds them to `result`."""
        while not self.take(")"):
            self.words(frozenset({"each", "final"}))
            if self.peek().text in ("redeclare", "replaceable"):
                self.redeclaration()
            elif self.peek().kind == "name" and self.peek(1).text == "=":
                key = self.name()
                result.named[key] = self.modification()
                self.description()
            else:
                value = self.expression()
                if isinstance(value, Call):
                    if self.take("="):
                        value.binding = self.expression()
                    self.description()
                    result.named[value.name] = value
                result.arguments.append(value)
            self.take(",")

    def redeclaration(self) -> None:
        """Skips a redeclaration."""
        while self.peek().text not in (",", ")"):
            if self.peek().kind == "end":
                raise self.error("the text ends within a modification")
            if self.next().text == "(":
                self.skip_brackets()

    def expression(self) -> Expression:
        """Takes an expression."""
        if self.take("if"):
            return self.conditional()
        first = self.binary(0)
        if self.peek().text != ":":
            return first
        parts = [first]
        while self.take(":"):
            parts.append(self.binary(0))
        return Operation(":", tuple(parts))

    def conditional(self) -> Operation:
        """Takes the rest of an if-expression after `if` or `elseif`."""
        condition = self.expression()
        self.expect("then")
        value = self.expression()
        if self.take("elseif"):
            return Operation("if", (condition, value, self.conditional()))
        self.expect("else")
        return Operation("if", (condition, value, self.expression()))

    def binary(self, level: int) -> Expression:
        """Takes operators of the precedence `level` or higher, with their operands."""
        if level == len(_BINARY):
            return self.unary()
        left = self.binary(level + 1)
        while self.peek().text in _BINARY[level] and self.peek().kind in ("symbol", "name"):
            operator = self.next().text
            left = Operation(operator, (left, self.binary(level + 1)))
        return left

    def unary(self) -> Expression:
        """Takes a sign, `not`, or a primary."""
        for operator in ("-", "+", "not"):
            if self.take(operator):
                return Operation(operator, (self.binary(3 if operator != "not" else 2),))
        return self.primary()

    def primary(self) -> Expression:
        """Takes a literal, a name, a call, an array, or an expression in brackets."""
        token = self.peek()
        if token.kind == "number":
            return float(self.next().text)
        if token.kind == "string":
            return self.next().text
        if token.text in ("true", "false"):
            return self.next().text == "true"
        if self.take("("):
            return self.sequence(")")
        if self.take("{"):
            return self.sequence("}", array=True)
        if self.take("["):
            self.skip_brackets()
            return Array(())
        if token.text == "end" or (token.kind != "name" and token.text != "."):
            raise self.error(f"an expression is expected before {token.text!r}")
        start = self.peek().start
        text = self.dotted_name()
        if self.take("("):
            result = Call(text)
            self.arguments(result)
            result.text = self._source[start : self._tokens[self._at - 1].stop]
            return result
        while self.peek().text in ("[", "."):
            self.subscripts()
            if self.take("."):
                text += f".{self.name()}"
        return Name(text)

    def sequence(self, close: str, *, array: bool = False) -> Expression:
        """Takes expressions up to a closing bracket."""
        values: list[Expression] = []
        while not self.take(close):
            values.append(self.expression())
            if self.take("for"):
                while self.peek().text != close:
                    self.next()
            if not self.take(","):
                self.expect(close)
                break
        return Array(tuple(values)) if array or len(values) != 1 else values[0]
