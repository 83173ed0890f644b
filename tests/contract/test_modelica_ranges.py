"""The ranges of analog terminals in EtherCAT.Conversions.Ranges are those of the profiles."""

import re
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RANGES = ROOT / "codegen/ecatgen/modelica/EtherCAT/Conversions/Ranges/package.mo"
SOURCE = RANGES.read_text("utf-8")
PROFILES = "".join(
    file.read_text("utf-8")
    for file in sorted((ROOT / "daemon/ecatd/config/profiles").glob("beckhoff*.toml"))
)
NUMBER = r"-?[\d.]+"


@dataclass(frozen=True)
class Line:
    """Raw values and the physical values that they stand for."""

    raw: tuple[float, float]
    physical: tuple[float, float]

    def at(self, raw: float) -> float:
        slope = (self.physical[1] - self.physical[0]) / (self.raw[1] - self.raw[0])
        return self.physical[0] + (raw - self.raw[0]) * slope


def ranges() -> dict[str, tuple[Line, str]]:
    """The constants of the package, with their descriptions."""
    found = re.findall(
        rf"AnalogRange (\w+)\(\s*rawMin = ({NUMBER}), rawMax = ({NUMBER}), "
        rf'min = ({NUMBER}), max = ({NUMBER})\)\s*"([^"]*)"',
        SOURCE,
    )
    return {
        name: (Line((float(a), float(b)), (float(c), float(d))), text)
        for name, a, b, c, d, text in found
    }


def profile(terminal: str) -> Line:
    """What the profile of a terminal says of its value."""
    device = next(d for d in PROFILES.split("[[device]]") if f"# {terminal}\n" in d)
    raw, physical = (
        re.search(rf"^{name} = \[({NUMBER}), ({NUMBER})\]", device, re.MULTILINE)
        for name in ("raw", "physical")
    )
    assert raw, terminal
    assert physical, terminal
    return Line((float(raw[1]), float(raw[2])), (float(physical[1]), float(physical[2])))


TERMINALS = [
    (name, terminal)
    for name, (_, text) in ranges().items()
    for terminal in re.findall(r"\bEL\d{4}\b", text)
]


def test_all_ranges_are_found() -> None:
    order = RANGES.with_name("package.order").read_text().split()
    assert list(ranges()) == order
    assert len(TERMINALS) >= 12


@pytest.mark.parametrize(("name", "terminal"), TERMINALS)
def test_a_range_is_that_of_the_profile(name: str, terminal: str) -> None:
    line, _ = ranges()[name]
    for raw in (-32767, 0, 12345, 32767):
        assert line.at(raw) == pytest.approx(profile(terminal).at(raw), abs=1e-9)


@pytest.mark.parametrize(
    ("name", "raw", "physical"),
    [
        ("voltage10V", -32767, -10),
        ("voltage10V", 26214, 8.0002),
        ("current4To20mA", 0, 0.004),
        ("current4To20mA", 32767, 0.02),
        ("temperature", 0, 273.15),
        ("temperature", 250, 298.15),
        ("perMille", 1000, 1),
    ],
)
def test_known_values(name: str, raw: float, physical: float) -> None:
    assert ranges()[name][0].at(raw) == pytest.approx(physical, rel=1e-5)
