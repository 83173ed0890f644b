"""When a model samples: the equations of a block with `sample()`, in the order of OpenModelica.

OpenModelica cannot be had from a package registry. This reads the source of a block and carries its
sampled equations out as the runtime of OpenModelica does: each `sample()` has an accumulator of its
own, next = next + interval, and two events are one if they are at most 1e-14 s apart.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pymoca import ast
from pymoca.parser import parse

SAME = 1e-14
"""SAMPLE_EPS of OpenModelica, in seconds."""

_OPERATORS: dict[str, Callable[..., Any]] = {
    "+": lambda *v: v[0] + v[1] if len(v) == 2 else v[0],
    "-": lambda *v: v[0] - v[1] if len(v) == 2 else -v[0],
    "*": operator.mul,
    "/": operator.truediv,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "and": lambda a, b: a and b,
    "or": lambda a, b: a or b,
    "not": operator.not_,
    "abs": abs,
    "floor": math.floor,
    "min": min,
    "max": max,
    "size": lambda values, _: len(values),
    "String": str,
}


_BUILT_IN = {"Real", "Integer", "Boolean", "String", "StateSelect", "Clock"}


class RefusedError(Exception):
    """An `assert` of Modelica that is false."""


@dataclass
class Event:
    """An instant at which a `sample()` is true.

    Attributes:
        time: Simulation time in s.
        calls: Names of the external functions that are called, without their package.
        sampled: The array of this name.
    """

    time: float
    calls: list[str]
    sampled: Sequence[bool]


@dataclass
class _Accumulator:
    next: float
    interval: float
    active: bool = False


@dataclass
class Clock:
    """The sampled equations of a block.

    Attributes:
        functions: Folder of the functions that it calls, one in a file.
        block: Source of the block, its only class.
        values: Parameters, and from then on all variables.
    """

    functions: Path
    block: str
    values: dict[str, Any]
    _accumulators: dict[tuple[Any, ...], _Accumulator] = field(default_factory=dict)
    _before: dict[str, Any] = field(default_factory=dict)
    _calls: list[str] = field(default_factory=list)
    _functions: dict[str, ast.Class | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._class = _only_class(parse(self.block))
        for name, symbol in self._class.symbols.items():
            given = _modified(symbol, "start") or _modified(symbol, "value")
            if name not in self.values and self._is_known(given):
                self.values[name] = self._value(given, self.values)
        self.values["sampled"] = [False] * len(self.values["sampleTime"])

    def _is_known(self, value: Any) -> bool:
        """Whether it is a number or made by a function in Modelica: samples need no other."""
        if isinstance(value, ast.Expression):
            return value.operator == "-" or self._function(value) is not None
        return isinstance(value, ast.Primary)

    def events(self) -> Iterator[Event]:
        """All events from the start on, for ever."""
        self._evaluate(set())  # finds the accumulators
        while True:
            time = min(a.next for a in self._accumulators.values())
            for accumulator in self._accumulators.values():
                accumulator.active = accumulator.next <= time + SAME
            self._before, self._calls = dict(self.values), []
            done: set[int] = set()
            present: object = None
            while present != (present := (repr(self.values), len(done))):
                self._evaluate(done)
            yield Event(time, self._calls, tuple(self.values["sampled"]))
            for accumulator in self._accumulators.values():
                if accumulator.active:
                    accumulator.next += accumulator.interval

    def _evaluate(self, done: set[int]) -> None:
        self._equations(self._class.equations, self.values, done)

    def _equations(self, equations: Sequence[Any], scope: dict[str, Any], done: set[int]) -> None:
        for equation in equations:
            if isinstance(equation, ast.ForEquation):
                for inner in self._loop(equation, scope):
                    self._equations(equation.equations, inner, done)
            elif isinstance(equation, ast.WhenEquation):
                ((condition, *_), (body, *_)) = equation.conditions, equation.blocks
                if id(equation) not in done and self._value(condition, scope):
                    done.add(id(equation))
                    self._equations(body, scope, done)
            elif isinstance(equation, ast.Equation):
                self._equation(equation, scope)

    def _equation(self, equation: ast.Equation, scope: dict[str, Any]) -> None:
        if isinstance(equation.left, ast.ComponentRef):
            value = self._value(equation.right, scope)
            if value is not None:
                self._assign(equation.left, value, scope)
        elif isinstance(equation.left, ast.Expression):  # der(x), or several outputs
            assert equation.left.operator == "der"
        else:
            self._value(equation.right, scope)

    def _assign(self, target: ast.ComponentRef, value: Any, scope: dict[str, Any]) -> None:
        ((index,),) = target.indices
        if index is None:
            scope[target.name] = value
        else:
            scope[target.name][self._value(index, scope) - 1] = value

    def _loop(self, loop: Any, scope: dict[str, Any]) -> Iterator[dict[str, Any]]:
        (index,) = loop.indices
        start, stop = (
            self._value(end, scope) for end in (index.expression.start, index.expression.stop)
        )
        for value in range(start, stop + 1):
            yield _Inner(scope, index.name, value)

    def _value(self, node: Any, scope: Mapping[str, Any]) -> Any:
        if isinstance(node, ast.Primary):
            return node.value
        if isinstance(node, ast.ComponentRef):
            ((index,),) = node.indices
            value = scope.get(node.name)
            return value if index is None else value[self._value(index, scope) - 1]
        if isinstance(node, ast.IfExpression):
            (condition,), (yes, no) = node.conditions, node.expressions
            return self._value(yes if self._value(condition, scope) else no, scope)
        assert isinstance(node, ast.Expression), node
        name = _name(node.operator)
        if name == "sample":
            start, interval = (self._value(operand, scope) for operand in node.operands)
            key = (id(node), *getattr(scope, "indices", ()))
            return self._accumulators.setdefault(key, _Accumulator(start, interval)).active
        if name == "pre":
            return self._before[node.operands[0].name]
        if name == "assert":
            condition, text = (self._value(operand, scope) for operand in node.operands)
            if not condition:
                raise RefusedError(text)
            return None
        function = self._function(node)
        if function is None and name not in _OPERATORS:
            self._calls.append(name)
            return None
        values = [self._value(operand, scope) for operand in node.operands]
        return _OPERATORS[name](*values) if function is None else self._call(function, values)

    def _function(self, node: ast.Expression) -> ast.Class | None:
        """The function that an expression calls, if it is written in Modelica."""
        name = _name(node.operator)
        if name not in self._functions:
            file = self.functions / f"{name}.mo"
            source = file.read_text("utf-8") if file.is_file() else ""
            here = source and 'external "C"' not in source
            self._functions[name] = _only_class(parse(source)) if here else None
        return self._functions[name]

    def _call(self, function: ast.Class, values: Sequence[Any]) -> Any:
        inputs = [n for n, s in function.symbols.items() if "input" in s.prefixes]
        (output,) = [n for n, s in function.symbols.items() if "output" in s.prefixes]
        scope = dict(zip(inputs, values, strict=True))
        self._statements(function.statements, scope)
        return scope[output]

    def _statements(self, statements: Sequence[Any], scope: dict[str, Any]) -> None:
        for statement in statements:
            if isinstance(statement, ast.ForStatement):
                for inner in self._loop(statement, scope):
                    self._statements(statement.statements, inner)
            else:
                assert isinstance(statement, ast.AssignmentStatement), statement
                value = self._value(statement.right, scope)
                for target in statement.left:
                    self._assign(target, value, scope)


class _Inner(dict[str, Any]):
    """The variables in a loop: assignments are to those around it."""

    def __init__(self, outer: dict[str, Any], name: str, value: int) -> None:
        super().__init__()
        self._outer, self._name, self._index = outer, name, value
        self.indices = (*getattr(outer, "indices", ()), value)

    def get(self, name: str, default: Any = None) -> Any:
        return self._index if name == self._name else self._outer.get(name, default)

    def __getitem__(self, name: str) -> Any:
        return self.get(name)

    def __setitem__(self, name: str, value: Any) -> None:
        self._outer[name] = value


def _only_class(tree: Any) -> ast.Class:
    while not (tree.equations or tree.statements):
        (tree,) = [found for name, found in tree.classes.items() if name not in _BUILT_IN]
    return tree


def _name(name: Any) -> str:
    """The last part of the name of a function or an operator."""
    while getattr(name, "child", None):
        (name,) = name.child
    return getattr(name, "name", name)


def _modified(symbol: ast.Symbol, attribute: str) -> Any:
    """What a declaration gives to `start`, or to `value`: its binding."""
    for argument in symbol.class_modification.arguments if symbol.class_modification else ():
        if argument.value.component.name == attribute:
            return argument.value.modifications[0]
    return None
