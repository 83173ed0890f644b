"""The tree of slaves as an SVG picture, for `ecatctl graph`."""

from __future__ import annotations

from collections.abc import Iterator

from ecatd.base.sanitized_output import xml_text
from ecatd.description.cables import BAD, STRAINED

from .slave_tree import Node, rows

_WIDTH, _HEIGHT, _GAP, _INDENT, _MARGIN = 360, 40, 14, 44, 16
_STYLE = """\
text { font: 13px sans-serif; fill: #222 }
.small { font-size: 11px; fill: #555 }
.bad { fill: #b00020 }
rect { fill: #fff; stroke: #888 }
.op { stroke: #2e7d32; stroke-width: 2 }
.not-op { fill: #fdecea; stroke: #b00020; stroke-width: 2 }
path { fill: none; stroke: #555; stroke-width: 2 }
.strained { stroke: #e08a00; stroke-width: 3 }
.broken { stroke: #b00020; stroke-width: 4 }"""


def svg_text(name: str, roots: list[Node]) -> str:
    """A picture with a box for each slave; the color of a link says how it is: strained or bad.

    Args:
        name: Name of the bus.
        roots: The slaves at the master.
    """
    placed = [
        (_MARGIN + depth * _INDENT, _MARGIN + (number + 1) * (_HEIGHT + _GAP), node)
        for number, (depth, node) in enumerate(rows(roots))
    ]
    at = {node.position: (x, y) for x, y, node in placed}
    before = {item.position: node.position for _, _, node in placed for item in node.behind}
    width = max((x for x, _, _ in placed), default=0) + _WIDTH + 2 * _MARGIN
    height = (len(placed) + 1) * (_HEIGHT + _GAP) + 2 * _MARGIN
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}" role="img">',
        f"<title>EtherCAT bus {xml_text(name)}</title>",
        f"<style>{_STYLE}</style>",
        f'<rect x="{_MARGIN}" y="{_MARGIN}" width="{_WIDTH}" height="{_HEIGHT}"/>',
        f'<text x="{_MARGIN + 10}" y="{_MARGIN + 25}">master, bus {xml_text(name)}</text>',
    ]
    for x, y, node in placed:
        start = at.get(before.get(node.position, -1), (_MARGIN, _MARGIN))
        if node.known:
            parts += _link(start, (x, y), node)
    for x, y, node in placed:
        parts += _box(x, y, node)
    return "\n".join([*parts, "</svg>"]) + "\n"


def _link(start: tuple[int, int], end: tuple[int, int], node: Node) -> Iterator[str]:
    kind = {STRAINED: ' class="strained"', BAD: ' class="broken"'}.get(node.fault, "")
    from_x, from_y, to_x = start[0] + 20, start[1] + _HEIGHT, end[0] + 20
    if from_x == to_x:
        yield f'<path{kind} d="M{from_x} {from_y} V{end[1]}"/>'
    else:
        middle = end[1] + _HEIGHT // 2
        yield f'<path{kind} d="M{from_x} {from_y} V{middle} H{end[0]}"/>'


def _box(x: int, y: int, node: Node) -> Iterator[str]:
    kind = "op" if node.state == "OP" else "not-op"
    yield f'<rect class="{kind}" x="{x}" y="{y}" width="{_WIDTH}" height="{_HEIGHT}" rx="3"/>'
    yield f'<text x="{x + 10}" y="{y + 17}">{node.position} {xml_text(node.name)}</text>'
    port = "" if node.port is None else f"at port {node.port}"
    facts = " · ".join(filter(None, (node.state or "no answer", port, node.delay_text)))
    yield f'<text class="small" x="{x + 10}" y="{y + 33}">{xml_text(facts)}</text>'
    if node.all_errors:
        yield (
            f'<text class="small bad" x="{x + _WIDTH - 10}" y="{y + 33}" text-anchor="end">'
            f"{xml_text(node.all_errors)}</text>"
        )
