"""Command `graph`: which slave is plugged in at which port, as a tree, for Graphviz, or as SVG."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from ecatd.base.errors import UsageError
from ecatd.base.sanitized_output import printable
from ecatd.description.bus import Bus
from ecatd.description.cables import BAD, STRAINED, LinkVerdict
from ecatd.etg.al import al_state_text
from ecatd.etg.port_errors import PORT_ORDER, SlaveErrors, links_with_errors
from ecatd.operations.bus import ReadStates, SlaveAlState

from .output import print_json
from .saving import add_out, save
from .slave_tree import Node, errors_text, rows

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

COMMANDS = {
    "bus": {"graph": "Show which slave is plugged in at which port, as a tree or a picture."}
}

_AT_MASTER = (-1, 0)
_COLORS = {STRAINED: "orange", BAD: "red"}
"""Colors of links in Graphviz, by verdict."""
_FORMATS = {".dot": "dot", ".gv": "dot", ".svg": "svg"}


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    add_out(command, "write it to FILE.dot for Graphviz, or to FILE.svg")


def graph(remote: Remote, options: argparse.Namespace) -> None:
    """Prints the tree of slaves, or writes it to a file."""
    kind = "" if options.out is None else _FORMATS.get(options.out.suffix.lower())
    if kind is None:
        raise UsageError(f"{options.out}: give a file name that ends with .dot or .svg")
    bus = remote.describe()
    roots = _tree(bus, *remote.cables(), remote.request(ReadStates())["slaves"])
    if kind:
        from .graph_svg import svg_text

        save(options.out, _dot(bus, roots) if kind == "dot" else svg_text(bus.name, roots))
    if options.json:
        slaves = [_document(node) for node in _all(roots)]
        print_json({"bus": bus.name, "slaves": slaves, "file": options.out and str(options.out)})
    elif kind:
        print(f"{options.out}: {len(bus.slaves)} slaves")
    else:
        print("\n".join(["master", *_lines(roots)]))


def _tree(
    bus: Bus, found: list[SlaveErrors], cables: list[LinkVerdict], states: list[SlaveAlState]
) -> list[Node]:
    """The slaves at the master: one, or several if it is not known where some are plugged in."""
    measured = any(slave.dc_delay_ns for slave in bus.slaves)  # if not, the clocks are not used
    nodes = {
        slave.position: Node(
            slave.position,
            slave.display_name,
            al_state_text(row["al_state"]) if row["al_state"] else "",
            slave.dc_delay_ns if slave.dc_bits and measured else None,
        )
        for slave, row in zip(bus.slaves, states, strict=True)
    }
    for item in cables:
        if item.before_port == 0 or item.before >= 0:  # else the way back to the second interface
            nodes[item.slave].cable = item
    for link in links_with_errors(found):
        first, (position, port) = link.ends
        if first is None:
            nodes[position].loose.append((port, link))
        else:
            nodes[position].errors = link
    leads = {(item.position, port.port): port.to for item in found for port in item.ports}
    inside: set[int] = set()
    for row in found:
        for port in PORT_ORDER:
            to = leads[row.position, port]
            if to == _AT_MASTER:
                nodes[row.position].known = True
            if to is None or to[0] <= row.position:  # a slave behind it comes later on the wire
                continue
            nodes[to[0]].port, nodes[to[0]].known = port, True
            nodes[row.position].behind.append(nodes[to[0]])
            inside.add(to[0])
    return [node for position, node in nodes.items() if position not in inside]


def _all(roots: list[Node]) -> Iterator[Node]:
    """All nodes, in the order of the frame."""
    waiting = roots[::-1]
    while waiting:
        node = waiting.pop()
        yield node
        waiting += node.behind[::-1]


def _document(node: Node) -> dict[str, Any]:
    return {
        "position": node.position,
        "name": node.name,
        "state": node.state or None,
        "delay_ns": node.delay_ns,
        "port": node.port,
        "behind": [item.position for item in node.behind],
        "known": node.known,
        "cable": None if node.cable is None else node.cable._asdict(),
        "errors": None if node.errors is None else node.errors._asdict(),
        "loose": [{"port": port, **errors._asdict()} for port, errors in node.loose],
    }


def _lines(roots: list[Node]) -> Iterator[str]:
    drawn = [
        (f"{'│  ' * depth}{node.position:>3}  {node.name}", node) for depth, node in rows(roots)
    ]
    width = max((len(text) for text, _ in drawn), default=0)
    for text, node in drawn:
        port = "" if node.port is None else f"port {node.port}"
        state = node.state or "no answer"
        cells = f"{text:<{width}}  {state:<10}{port:<8}{node.delay_text:>9}  {node.all_errors}"
        yield cells.rstrip()


def _dot_text(text: str) -> str:
    """Text inside a string of Graphviz."""
    return printable(text).replace("\\", "\\\\").replace('"', '\\"')


def _dot(bus: Bus, roots: list[Node]) -> str:
    """The tree in the language of Graphviz."""
    lines = [
        f'digraph "{_dot_text(bus.name)}" {{',
        "  rankdir=LR;",
        '  node [shape=box, style=filled, fillcolor="white", fontname="sans-serif"];',
        '  edge [dir=none, fontname="sans-serif", fontsize=10];',
        "  master [shape=ellipse];",
    ]
    for node in _all(roots):
        words = [f"{node.position} {node.name}", node.state or "no answer", node.delay_text]
        words += [f"port {port}: {errors_text(errors)}" for port, errors in node.loose]
        label = "\\n".join(_dot_text(word) for word in words if word)
        color = "white" if node.state == "OP" else "mistyrose"
        lines.append(f'  s{node.position} [label="{label}", fillcolor="{color}"];')
    before = {item.position: node.position for node in _all(roots) for item in node.behind}
    for node in filter(lambda node: node.known, _all(roots)):
        start = f"s{before[node.position]}" if node.position in before else "master"
        port = "" if node.port is None else f'taillabel="{node.port}", '
        color = _COLORS.get(node.fault, "black")
        lines.append(
            f'  {start} -> s{node.position} [{port}label="{node.error_text}", color="{color}"];'
        )
    return "\n".join([*lines, "}"]) + "\n"
