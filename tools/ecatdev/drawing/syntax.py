"""Reads what a drawing needs of a Modelica file: classes, their elements, annotations, expressions.

pymoca parses. Its syntax tree has no annotations of connections and no names of arguments of
functions, so the tree here is made of what the parser of its grammar gives.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import antlr4
from pymoca.generated.ModelicaLexer import ModelicaLexer
from pymoca.generated.ModelicaParser import ModelicaParser as Grammar
from pymoca.parser import ModelicaParserErrorListener, ModelicaSyntaxError

_STRING = re.compile(r'"((?:[^"\\]|\\.)*)"', re.DOTALL)
_ESCAPE = re.compile(r"\\(.)", re.DOTALL)
_ESCAPES = {"n": "\n", "t": "\t", "r": "\r", "a": "\a", "b": "\b", "f": "\f", "v": "\v"}


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
        named: Arguments by name, or the modifications of elements by their names.
        binding: Value after `=`.
        text: Source text of the binding.
    """

    name: str = ""
    arguments: list[Expression] = field(default_factory=list)
    named: dict[str, Call] = field(default_factory=dict)
    binding: Any = None
    text: str = ""

    def part(self, name: str) -> Call:
        """Returns the modification of an element, or an empty one if there is none."""
        return self.named.get(name) or Call(name)


Expression = float | str | bool | Name | Operation | Array | Call


@dataclass(slots=True)
class Component:
    """A component of a class.

    Attributes:
        name: Its name.
        class_name: Class as written.
        modification: Modifiers and binding.
        condition: Condition of the component, None if it always exists.
        annotation: Its annotation.
        public: Whether it is declared in a public section.
    """

    name: str
    class_name: str
    modification: Call
    condition: Expression | None
    annotation: Call
    public: bool


@dataclass(slots=True)
class Extends:
    """An extends clause: base class and modifiers."""

    class_name: str
    modification: Call


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
        partial: Whether it is only a base of others.
        description: Its description string.
        elements: Components in their order.
        bases: Base classes; a short class has one.
        classes: Inner classes, by name.
        imports: Full name of each imported class, by its short name.
        connects: Its connect equations.
        annotation: Its annotation.
    """

    name: str
    kind: str
    partial: bool
    description: str
    annotation: Call
    elements: list[Component] = field(default_factory=list)
    bases: list[Extends] = field(default_factory=list)
    classes: dict[str, Class] = field(default_factory=dict)
    imports: dict[str, str] = field(default_factory=dict)
    connects: list[Connect] = field(default_factory=list)


@cache
def parse(source: str) -> Class:
    """Returns the class that a file defines. A text is parsed once: that is slow.

    Raises:
        ModelicaSyntaxError: The text is not a class.
    """
    lexer = ModelicaLexer(antlr4.InputStream(source))
    parser = Grammar(antlr4.CommonTokenStream(lexer))
    for recognizer in (lexer, parser):
        recognizer.removeErrorListeners()
        recognizer.addErrorListener(ModelicaParserErrorListener())
    definitions = parser.stored_definition().stored_definition_class()
    if len(definitions) != 1 or parser.getCurrentToken().type != antlr4.Token.EOF:
        raise ModelicaSyntaxError(f"line {parser.getCurrentToken().line}: a file has one class")
    return _class(definitions[0].class_definition())


def _class(tree: Any) -> Class:
    prefixes, body = tree.class_prefixes(), tree.class_specifier()
    match body:
        case Grammar.Class_spec_compContext():
            name, description = body.IDENT(0), body.string_comment()
            annotation = body.composition().comp_annotation
        case Grammar.Class_spec_baseContext() | Grammar.Class_spec_enumContext():
            name, description = body.IDENT(), body.comment().string_comment()
            annotation = body.comment().annotation()
        case _:
            raise ModelicaSyntaxError(f"line {body.start.line}: no drawing knows such a class")
    result = Class(
        name.getText(),
        prefixes.class_type().children[-1].getText(),  # "expandable connector": the last word
        prefixes.PARTIAL() is not None,
        _text(description),
        _annotation(annotation),
    )
    if isinstance(body, Grammar.Class_spec_compContext):
        _fill(result, body.composition())
    elif isinstance(body, Grammar.Class_spec_baseContext):
        result.bases.append(_extends(body))
    return result


def _fill(result: Class, composition: Any) -> None:
    for part in composition.children:
        if isinstance(part, Grammar.Element_listContext):
            for element in part.element():
                _add(result, element.children[0], public=part not in composition.epro)
    for section in composition.equation_section():
        for equation in _all(section, Grammar.EquationContext):
            options = equation.equation_options()
            if isinstance(options, Grammar.Equation_connect_clauseContext):
                a, b = options.connect_clause().component_reference()
                annotation = _annotation(equation.comment().annotation())
                result.connects.append(Connect(a.getText(), b.getText(), annotation))


def _add(result: Class, element: Any, *, public: bool) -> None:
    match element:
        case Grammar.Import_clauseContext():
            path = element.component_reference().getText()
            short = element.IDENT() or path.rpartition(".")[2]
            result.imports[str(short)] = path
        case Grammar.Extends_clauseContext():
            result.bases.append(_extends(element))
        case _ if element.class_elem is not None:
            inner = _class(element.class_elem)
            result.classes[inner.name] = inner
        case _:
            clause = element.comp_elem
            for tree in clause.component_list().component_declaration():
                declaration, condition = tree.declaration(), tree.condition_attribute()
                component = Component(
                    declaration.IDENT().getText(),
                    clause.type_specifier().getText(),
                    _modification(declaration.modification()),
                    None if condition is None else _expression(condition.expression()),
                    _annotation(tree.comment().annotation()),
                    public,
                )
                result.elements.append(component)


def _all(tree: Any, kind: type) -> Iterator[Any]:
    """Yields the parts of a kind in a part of the text, in their order."""
    for child in getattr(tree, "children", None) or ():
        if isinstance(child, kind):
            yield child
        yield from _all(child, kind)


def _extends(tree: Any) -> Extends:
    modification = _modifiers(Call(), tree.class_modification())
    return Extends(tree.component_reference().getText(), modification)


def _annotation(tree: Any) -> Call:
    return Call() if tree is None else _modifiers(Call(), tree.class_modification())


def _modification(tree: Any, name: str = "") -> Call:
    result = Call(name)
    if isinstance(tree, Grammar.Modification_classContext):
        _modifiers(result, tree.class_modification())
    if tree is not None and tree.expression() is not None:
        result.binding, result.text = _expression(tree.expression()), _source(tree.expression())
    return result


def _modifiers(result: Call, tree: Any) -> Call:
    """Adds modifiers in brackets to a modification; redeclarations change no drawing."""
    listed = None if tree is None else tree.argument_list()
    for argument in () if listed is None else listed.argument():
        modifier = argument.element_modification_or_replaceable()
        element = None if modifier is None else modifier.element_modification()
        if element is not None:
            name = element.component_reference().getText()
            result.named[name] = _modification(element.modification(), name)
    return result


def _call(tree: Any) -> Call:
    result = Call(_reference(tree.component_reference()), text=_source(tree))
    arguments = tree.function_call_args().function_arguments()
    if arguments is not None:
        result.arguments += [_expression(argument) for argument in arguments.function_argument()]
        named = arguments.named_arguments()
        for argument in () if named is None else named.named_argument():
            value = argument.function_argument()
            name = argument.IDENT().getText()
            result.named[name] = Call(name, binding=_expression(value), text=_source(value))
    return result


def _expression(tree: Any) -> Expression:
    match tree:
        case Grammar.Expression_ifContext():
            *values, result = [_expression(block) for block in tree.blocks]
            conditions = [_expression(condition) for condition in tree.conditions]
            for condition, value in zip(reversed(conditions), reversed(values), strict=True):
                result = Operation("if", (condition, value, result))
            return result
        case Grammar.Primary_unsigned_numberContext():
            return float(tree.getText())
        case Grammar.Primary_stringContext():
            return _text(tree)
        case Grammar.Primary_trueContext() | Grammar.Primary_falseContext():
            return bool(tree.getText() == "true")
        case Grammar.Primary_functionContext():
            return _call(tree)
        case Grammar.Primary_component_referenceContext():
            return Name(_reference(tree.component_reference()))
        case Grammar.Primary_function_argumentsContext():
            elements = tree.function_arguments().function_argument()
            return Array(tuple(_expression(element) for element in elements))
    parts = [part for part in tree.children if isinstance(part, antlr4.ParserRuleContext)]
    words = [part.getText() for part in tree.children if part not in parts]
    operands = tuple(_expression(part) for part in parts)
    if len(operands) == 1 and words in ([], ["(", ")"]):
        return operands[0]
    return Operation(words[0], operands)


def _reference(tree: Any) -> str:
    """Returns the name of a component or function, without its subscripts."""
    return ".".join(part.IDENT().getText() for part in tree.component_reference_element())


def _source(tree: Any) -> str:
    return str(tree.start.getInputStream().getText(tree.start.start, tree.stop.stop))


def _text(tree: Any) -> str:
    """Returns the text of string literals, which `+` may join."""
    return "".join(
        _ESCAPE.sub(lambda match: _ESCAPES.get(match[1], match[1]), literal)
        for literal in _STRING.findall(tree.getText())
    )
