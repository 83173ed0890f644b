"""Icons and diagrams: from annotations to geometry, and what the checks see in them."""

import math
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from conftest import names, naming
from ecatdev.drawing.__main__ import main
from ecatdev.drawing.checks import check_diagram, check_icon
from ecatdev.drawing.geometry import Box, Point, Transform, arc, bezier, moved, placed, rounded
from ecatdev.drawing.library import Libraries, NoSuchClassError
from ecatdev.drawing.scene import Scene, diagram, drag_scale, icon
from ecatdev.drawing.shapes import Label, Shape
from ecatdev.drawing.svg import Svg
from ecatdev.drawing.syntax import ModelicaSyntaxError, parse
from ecatgen import font

MODELICA = """
within ;
package Lab "A library"
  connector In = input Real annotation (Icon(graphics = {
    Polygon(points = {{-100, 100}, {100, 0}, {-100, -100}}, lineColor = {0, 0, 127})}));
  connector Out = output Real;
  type Mode = enumeration(Slow "s", Fast);

  partial block Base
    parameter Integer k = 3;
    In u annotation (Placement(transformation(extent = {{-140, -20}, {-100, 20}})));
    Out y annotation (Placement(transformation(extent = {{100, -10}, {120, 10}}),
      iconTransformation(origin = {80, 110}, extent = {{-10, -10}, {10, 10}}, rotation = 90)));
    annotation (Icon(graphics = {
      Rectangle(extent = {{-100, -100}, {100, 100}}),
      Text(extent = {{-150, 150}, {50, 110}}, textString = "%name"),
      Text(extent = {{-100, -20}, {100, 20}}, textString = "k=%k 100%%")}));
  end Base;

  block Gain
    extends Base(k = 7);
    parameter Mode mode = Mode.Slow;
    In extra if mode == Lab.Mode.Fast
      annotation (Placement(transformation(extent = {{-140, 60}, {-100, 100}})));
    annotation (Icon(graphics = {
      Ellipse(extent = {{-50, 50}, {50, -50}}, visible = mode == Mode.Fast),
      Text(extent = {{-90, -60}, {90, -90}}, textString = "%{mode} of %class")}));
  end Gain;

  model Example
    Gain a(k = 2 * 4) annotation (Placement(transformation(extent = {{-50, -10}, {-30, 10}})));
    Gain b(mode = Mode.Fast)
      annotation (Placement(transformation(origin = {20, 0}, extent = {{-10, 10}, {10, -10}})));
    Gain turned annotation (Placement(
      transformation(origin = {60, 40}, extent = {{-10, -10}, {10, 10}}, rotation = 90)));
  equation
    for i in 1:3 loop
      connect(a.y, b.u) annotation (Line(points = {{-32, 11}, {-32, 30}, {0, 30}, {0, 0}, {8, 0}}));
    end for;
    // connect(b.y, a.u);
    connect(turned.y, a.extra) annotation (Line(points = {{49, 48}, {-60, 48}, {-60, 8}}));
  end Example;
end Lab;
"""


@pytest.fixture
def lab(tmp_path: Path) -> Libraries:
    (tmp_path / "Lab.mo").write_text(MODELICA)
    return Libraries([tmp_path])


def edited(tmp_path: Path, old: str, new: str) -> Libraries:
    assert old in MODELICA
    (tmp_path / "Lab.mo").write_text(MODELICA.replace(old, new, 1))
    return Libraries([tmp_path])


def texts(items: list[Shape | Label]) -> list[str]:
    return [item.text for item in items if isinstance(item, Label)]


def close(a: Point, x: float, y: float) -> bool:
    return math.dist(a, (x, y)) < 1e-9


def test_a_file_gives_classes_components_and_connections() -> None:
    lab = parse(MODELICA)
    assert list(lab.classes) == ["In", "Out", "Mode", "Base", "Gain", "Example"]
    assert lab.description == "A library"
    assert [lab.classes[name].kind for name in ("In", "Mode", "Base")] == [
        "connector",
        "type",
        "block",
    ]
    assert [name for name, inner in lab.classes.items() if inner.partial] == ["Base"]
    example = lab.classes["Example"]
    assert [c.name for c in example.elements] == ["a", "b", "turned"]
    assert [(c.a, c.b) for c in example.connects] == [("a.y", "b.u"), ("turned.y", "a.extra")]


@pytest.mark.parametrize(
    ("source", "problem"),
    [
        ("model A", "line 1"),
        ("model A\n  Real x = ;\nend A;", "';'.* line 2"),
        ("model A annotation (Icon(graphics = {); end A;", "line 1"),
        ("model A\n\n  # end A;", "'#'.* line 3"),
        ("model A equation if x then y = 1;", "line 1"),
        ("model A end A;\nrubbish", "line 2: a file has one class"),
        ("package P\n  model extends A end A;\nend P;", "line 2: no drawing knows such a class"),
    ],
)
def test_what_is_no_modelica_is_told_with_its_line(source: str, problem: str) -> None:
    with pytest.raises(ModelicaSyntaxError, match=problem):
        parse(source)


def test_classes_are_found_from_inside_through_bases_and_imports(lab: Libraries) -> None:
    found = lab.find("Gain", "Lab.Example")
    assert found is not None
    assert found.path == "Lab.Gain"
    assert lab.find("Real", "Lab") is None
    with pytest.raises(NoSuchClassError, match=naming("Nowhere.X")):
        lab.find("Nowhere.X", "Lab.Example")


def test_an_icon_has_what_its_base_has_and_its_own(lab: Libraries) -> None:
    scene = icon(lab, "Lab.Gain", "gain1")
    assert texts(scene.items) == ["gain1", "k=7 100%", "Slow of Gain"]
    assert list(scene.parts) == ["u", "y"]
    assert scene.parts["u"].box.centre == (-120, 0)
    assert scene.parts["y"].box.centre == (80, 110)  # the place in the icon is its own
    assert not [item for item in scene.items if isinstance(item, Label) and item.angle]


def test_conditional_connectors_and_invisible_shapes_follow_parameters(lab: Libraries) -> None:
    parts = diagram(lab, "Lab.Example").parts
    assert list(parts["a"].parts) == ["u", "y"]
    assert list(parts["b"].parts) == ["u", "y", "extra"]
    assert len(parts["b"].items) == len(parts["a"].items) + 1
    assert "k=2 * 4 100%" in texts(parts["a"].items)
    assert "Fast of Gain" in texts(parts["b"].items)


def test_a_connection_to_what_is_not_there_is_not_drawn(lab: Libraries) -> None:
    assert [(w.a, w.b) for w in diagram(lab, "Lab.Example").lines] == [("a.y", "b.u")]


def test_components_are_where_their_placement_says(lab: Libraries) -> None:
    parts = diagram(lab, "Lab.Example").parts
    assert parts["a"].parts["u"].box.centre == (-52, 0)
    assert parts["b"].parts["u"].box.centre == (8, 0)
    assert close(parts["b"].parts["y"].box.centre, 28, -11)  # mirrored upside down
    assert close(parts["turned"].parts["u"].box.centre, 60, 28)
    assert close(parts["turned"].parts["y"].box.centre, 49, 48)
    triangle = parts["turned"].parts["u"].items[0]
    assert isinstance(triangle, Shape)
    assert close(triangle.outline.points[1], 60, 30)  # its tip touches the block
    name = next(item for item in parts["turned"].items if isinstance(item, Label))
    assert (name.text, name.angle) == ("turned", 90)


def test_a_coordinate_system_keeps_its_proportions_unless_told() -> None:
    system = Box(-100, -50, 100, 50)
    to = placed(system, Point(0, 0), Point(20, 20), keep_ratio=True)
    assert to(Point(100, 50)) == (20, 15)
    to = placed(system, Point(20, 0), Point(0, 20), keep_ratio=False)
    assert to(Point(100, 50)) == (0, 20)


def test_icons_are_as_large_as_they_are_dragged(tmp_path: Path) -> None:
    system = "coordinateSystem(extent = {{-100, -100}, {100, 100}}, initialScale = 0.2), graphics"
    lab = edited(
        tmp_path, "Icon(graphics = {\n      Rectangle", f"Icon({system} = {{\n      Rectangle"
    )
    assert drag_scale(lab, "Lab.Gain") == 0.2
    assert drag_scale(lab, "Lab.In") == 0.1


def test_transformations_come_after_each_other() -> None:
    to = moved(Point(10, 0), 90).after(Transform(2, 0, 0, 2))
    assert close(to(Point(1, 0)), 10, 2)
    assert moved(Point(0, 0), 180).angle == 0  # texts are never upside down
    assert moved(Point(0, 0), 270).angle == 90


def test_curves() -> None:
    circle = arc(Box(-1, -1, 1, 1), 0, 360)
    assert len(circle.segments) == 4
    assert close(circle.segments[0][-1], 0, 1)
    quarter = arc(Box(-1, -1, 1, 1), 90, 180)
    assert close(quarter.start, 0, 1)
    assert close(quarter.segments[-1][-1], -1, 0)
    smooth = bezier([Point(0, 0), Point(1, 2), Point(3, 2), Point(4, 0)])
    assert close(smooth.segments[0][-1], 2, 2)  # through the middle of the middle line
    assert close(smooth.segments[-1][-1], 4, 0)
    box = rounded(Box(0, 0, 10, 4), 25)
    assert close(box.start, 2, 0)  # never rounder than a half circle


def test_texts_shrink_to_their_extent() -> None:
    assert font.width("iii") < font.width("mmm") < font.width("mmm", bold=True) + 1e-9
    wide, narrow = font.fitted("Wheel", 1000, 20), font.fitted("Wheel", 10, 20)
    assert wide == pytest.approx(20 / font.LINE)
    assert narrow * font.width("Wheel") == pytest.approx(10)
    assert font.fitted("two\nlines", 0, 20) == pytest.approx(10 / font.LINE)


def test_a_sound_icon_and_diagram_have_no_findings(lab: Libraries) -> None:
    assert list(check_icon(icon(lab, "Lab.Gain"))) == []
    assert list(check_diagram(diagram(lab, "Lab.Example"))) == []


def test_elements_of_an_array_have_the_place_of_the_array(tmp_path: Path) -> None:
    lab = edited(tmp_path, "connect(a.y, b.u)", "connect(a.y[1], b.u[2:3])")
    assert list(check_diagram(diagram(lab, "Lab.Example"))) == []


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("{8, 0}}", "{8, 1}}", "connect(a.y, b.u) ends at {8, 1}, but b.u is at {8, 0}"),
        ("{{-32, 11}, ", "{{-30, 0}, ", "ends at {-30, 0}, but a.y is at {-32, 11}"),
        ("connect(a.y", "connect(a.z", "a.z has no place"),
        ("annotation (Line(points = {{-32, 11}", "annotation (Dot(points = {{1, 1}", "no line"),
        ("{-32, 30}, {0, 30}, {0, 0}", "{-32, 5}, {0, 5}, {0, 0}", "crosses a"),
        ("{-32, 30}, {0, 30}", "{-46, 30}, {-46, 13}, {0, 13}", "crosses the text 'a' of a"),
        ("origin = {60, 40}", "origin = {40, 10}", "b and turned overlap"),
    ],
)
def test_the_check_of_diagrams_sees(tmp_path: Path, old: str, new: str, problem: str) -> None:
    lab = edited(tmp_path, old, new)
    assert problem in "\n".join(check_diagram(diagram(lab, "Lab.Example")))


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("origin = {80, 110}", "origin = {-110, 10}", "connectors u and y overlap"),
        ("{-90, -60}, {90, -90}", "{-90, 10}, {90, -20}", "'k=7 100%' and 'Slow of Gain' overlap"),
        ("{-90, -60}, {90", "{-90, -60}, {-20", "'Slow of Gain' is squeezed to"),
        ("{-100, -20}, {100, 20}", "{-250, -20}, {0, 20}", "lies on the connector u"),
    ],
)
def test_the_check_of_icons_sees(tmp_path: Path, old: str, new: str, problem: str) -> None:
    assert problem in "\n".join(check_icon(icon(edited(tmp_path, old, new), "Lab.Gain")))


def test_lines_of_two_signals_may_cross_but_not_lie_upon_each_other(lab: Libraries) -> None:
    scene = diagram(lab, "Lab.Example")
    other = diagram(lab, "Lab.Example").lines[0]
    other.a, other.b = "turned.y", "turned.u"
    scene.lines.append(other)
    assert any("lies upon" in finding for finding in check_diagram(scene))
    other.points = [Point(-45, 20), Point(5, 20)]
    assert not any("lies upon" in finding for finding in check_diagram(scene))


def drawn(scene: Scene) -> str:
    svg = Svg(scene.box, "A & B")
    svg.scene(scene)
    return svg.write()


def test_svg_is_xml_with_y_downwards(lab: Libraries) -> None:
    text = drawn(icon(lab, "Lab.Gain"))
    root = ET.fromstring(text)
    space = "{http://www.w3.org/2000/svg}"
    assert root.find(f"{space}title").text == "A & B"  # type: ignore[union-attr]
    assert root.get("viewBox") == "-100 -100 200 200"
    name = next(t for t in root.iter(f"{space}text") if t.text == "gain")
    assert float(name.get("y", "")) == pytest.approx(-130 + font.MIDDLE * 40 / font.LINE, abs=0.01)
    assert text == drawn(icon(lab, "Lab.Gain"))


@pytest.mark.parametrize(
    ("pattern", "element"),
    [
        ("HorizontalCylinder", "linearGradient"),
        ("VerticalCylinder", "linearGradient"),
        ("Sphere", "radialGradient"),
        ("CrossDiag", "pattern"),
    ],
)
def test_fillings_are_defined_once(tmp_path: Path, pattern: str, element: str) -> None:
    fill = (
        f"Rectangle(fillPattern = FillPattern.{pattern}, extent = {{{{-100, -100}}, {{100, 100}}}})"
    )
    lab = edited(tmp_path, "Rectangle(extent = {{-100, -100}, {100, 100}})", f"{fill}, {fill}")
    text = drawn(icon(lab, "Lab.Gain"))
    assert text.count(f"<{element} id=") == 1
    assert text.count("url(#d1)") == 2


@pytest.mark.long
def test_the_command_replaces_pictures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "Old.svg").write_text("no longer a picture")
    (tmp_path / "photo.png").write_text("of somebody else")
    assert main([str(tmp_path)]) == 0
    files = {file.name for file in tmp_path.iterdir()}
    assert {"EtherCAT.svg", "TrollPlant.svg", "photo.png"} <= files
    assert "Old.svg" not in files
    assert str(tmp_path / "EtherCAT.svg") in capsys.readouterr().out
    assert main([str(tmp_path), "--standard-library", str(tmp_path)]) == 1
    names(capsys.readouterr().err, "nothing is drawn", "Modelica")
