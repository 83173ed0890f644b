"""Each counter is in `ecat_shm.def` once, is counted somewhere, and is shown everywhere."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from test_stats_shared_memory import made_memory, name_of, row

from ecatd.base.errors import StateError
from ecatd.cli.shared_memory_screen import contents_lines
from ecatd.cli.stats_screen import stats_lines
from ecatd.shm import contract as shm
from ecatd.shm.contents import contents
from ecatd.shm.statistics import from_map, read, to_map
from ecatd.shm.statistics.open_metrics import write_metrics

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
WHOLE = {item.name: n + 1001 for n, item in enumerate(shm.COUNTERS)}
OF_DOMAIN = {item.name: n + 2001 for n, item in enumerate(shm.DOMAIN_COUNTERS)}


def table(page: str, head: str) -> list[list[str]]:
    """The rows of a table in Markdown, as cells."""
    text = (DOCS / page).read_text()
    assert text.count(head) == 1
    rows = text.partition(head)[2].partition("\n\n")[0].splitlines()[2:]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in rows]


def test_what_is_counted_arrives_everywhere() -> None:
    with made_memory() as shared:
        for name, value in WHOLE.items():
            setattr(shared.health, name, value)
        status = row(shared, "domain_status", "ecat_shm_domain_status")
        for name, value in OF_DOMAIN.items():
            setattr(status, name, value)
        found = read(name_of(shared))
        document = contents(name_of(shared))
    far = from_map(to_map(found, buckets=True))
    assert far.counters == found.counters == WHOLE
    assert far.domains[0].counters == found.domains[0].counters == OF_DOMAIN
    assert to_map(found).items() >= WHOLE.items()
    assert document["health"].items() >= WHOLE.items()
    metrics = write_metrics(found, StateError("unknown")).splitlines()
    screen = "\n".join(stats_lines(found, found))
    two_domains = "\n".join(stats_lines(replace(found, domains=found.domains * 2), None))
    memory = "\n".join(contents_lines(document))
    for item in shm.COUNTERS:
        name = f"ecat_{item.name}"
        if item.unit == "ns":
            name, value = f"{name.removesuffix('_ns')}_seconds", str(WHOLE[item.name] / 1e9)
            assert f"# UNIT {name} seconds" in metrics
        else:
            value = str(WHOLE[item.name])
            assert re.search(rf"\b{item.label} +{value}\b", screen), item.label
            assert re.search(rf"\b{item.label} +{value}\b", memory), item.label
        assert f"# HELP {name} {item.meaning[0].upper()}{item.meaning[1:]}." in metrics
        assert f'{name}_total{{bus="{found.bus}"}} {value}' in metrics
    for item in shm.DOMAIN_COUNTERS:
        assert item.label.upper() in two_domains
        assert any(
            line.startswith(f"ecat_domain_{item.name}_total{{")
            and line.endswith(f" {OF_DOMAIN[item.name]}")
            for line in metrics
        )


@pytest.mark.parametrize(
    ("struct", "items"),
    [
        ("health", shm.COUNTERS),
        ("status|domain_status", shm.DOMAIN_COUNTERS),
        ("shared", shm.CAN_COUNTERS),
    ],
)
def test_each_is_counted_somewhere(struct: str, items: tuple[shm.Counter, ...]) -> None:
    engine = "".join(file.read_text() for file in (ROOT / "daemon" / "cyclic").glob("*.c"))
    counted = {*re.findall(rf"counter_add\(&\S*\b(?:{struct})->(\w+), ", engine)}
    watch = (ROOT / "daemon" / "ecatd" / "server" / "watch" / "interfaces.py").read_text()
    written = {*re.findall(r"self\._health\.(\w+) = ", watch)}
    known = {item.name for item in items}
    assert counted <= known, "it is no ECAT_COUNTER"
    assert known <= counted | written, "nobody counts it"


def test_each_says_what_it_is() -> None:
    for item in (*shm.COUNTERS, *shm.DOMAIN_COUNTERS, *shm.CAN_COUNTERS):
        assert item.severity in ("info", "notice", "warning"), item.name
        assert item.unit == "ns" or item.unit in item.meaning, "the meaning names what is counted"
        assert item.name.endswith("_ns") == (item.unit == "ns")
        assert not item.meaning.endswith("."), "in tables it is no sentence"


def test_pages_have_each_of_them() -> None:
    rows = table("command-line.md", "| counter | what it counts |")
    assert [cells[:3] for cells in rows] == [
        [f"`{item.name}`", item.meaning, item.severity] for item in shm.COUNTERS
    ]
    assert all(cells[3] for cells in rows), "what to do"
    times = table("command-line.md", "| time | what it is |")
    assert times == [[f"`{name}`", meaning] for name, meaning in shm.TIMES.items()]
    causes = [cells[0] for cells in table("troubleshooting.md", "| counter | cause | remedy |")]
    named = {name for text in causes for name in re.findall(r"`(\w+)`", text)}
    assert named == {item.name for item in shm.COUNTERS if item.severity == "warning"}
