"""The templates' environment: it writes what the filters have made, and refuses plain text."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from jinja2 import BaseLoader, Environment, StrictUndefined, Undefined, nodes, pass_context
from jinja2.compiler import CodeGenerator, Frame
from jinja2.runtime import Context

from .text import NOTHING, Code, Language, PlainTextError, code, rendered

_LANGUAGES = {
    ".mo.j2": {Language.MODELICA, Language.DOCUMENTATION},
    ".h.j2": {Language.C},
    ".xml.j2": {Language.XML},
    ".txt.j2": {Language.TABLE},
}
"""What a template of this name can hold. A template `*.html.j2` says it for its environment."""


class _Generator(CodeGenerator):
    """Tells texts that stand in a template from those that come from elsewhere."""

    def visit_Const(self, node: nodes.Const, frame: Frame) -> None:  # noqa: N802  Jinja's name
        """Writes a literal of the template, which its author vouches for."""
        value = node.as_const(frame.eval_ctx)
        if isinstance(value, str):
            self.write(f"environment.literal({str(value)!r})")
        else:
            super().visit_Const(node, frame)

    def _output_child_pre(self, node: nodes.Expr, frame: Frame, finalize: Any) -> None:
        self.write(finalize.src)  # and no `str()` around it, which would make plain text of code

    def _output_child_post(self, node: nodes.Expr, frame: Frame, finalize: Any) -> None:
        self.write(")")

    def visit_FilterBlock(  # noqa: N802  Jinja's name
        self, node: nodes.FilterBlock, frame: Frame
    ) -> None:
        """Refuses `{% filter %}`, which writes the result of any filter without a look at it."""
        self.fail("write {{ text | FILTER }}: a block {% filter %} cannot be checked", node.lineno)


class CheckedEnvironment(Environment):
    """An environment that writes code and numbers only.

    Args:
        loader: Finds the templates.
        html: The language of templates with the name `*.html.j2`.
        filters: The filters of the target languages.
    """

    code_generator_class = _Generator
    concat = staticmethod(rendered)
    literal = Code

    def __init__(
        self, loader: BaseLoader, html: Language, filters: Mapping[str, Callable[..., Code]]
    ) -> None:
        super().__init__(
            loader=loader,
            undefined=StrictUndefined,
            finalize=self._written,
            trim_blocks=True,
            lstrip_blocks=True,
            keep_trailing_newline=True,
            autoescape=False,  # the filters escape for the language of each place
            auto_reload=False,
        )
        self._languages = _LANGUAGES | {".html.j2": {html}}
        self.filters |= {**filters, "join": _join}

    @pass_context
    def _written(self, context: Context, value: Any) -> Code:
        """Checks a value that a template writes.

        Raises:
            PlainTextError: It is plain, or was escaped for another language.
        """
        if isinstance(value, Undefined):
            str(value)  # raises, unless it is the missing `else` of a condition
            return NOTHING
        text = code(value)
        name = context.name or ""
        known = next((k for end, k in self._languages.items() if name.endswith(end)), set())
        for language in text.languages - known:
            wanted = " or ".join(sorted(known)) or "names and numbers only"
            raise PlainTextError(
                f"{text[:40]!r} was written for {language}, but this template has {wanted}: take "
                "another filter"
            )
        return text


def _join(values: Any, separator: Code = NOTHING) -> Code:
    """Code, with a text of the template between its parts."""
    return separator.join(values)
