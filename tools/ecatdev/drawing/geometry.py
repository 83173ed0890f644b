"""Points, boxes, transformations and curves."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple


class Point(NamedTuple):
    """A point; the y axis points up."""

    x: float
    y: float


class Box(NamedTuple):
    """A rectangle along the axes."""

    x1: float
    y1: float
    x2: float
    y2: float

    @property
    def width(self) -> float:
        """Its width."""
        return self.x2 - self.x1

    @property
    def height(self) -> float:
        """Its height."""
        return self.y2 - self.y1

    @property
    def centre(self) -> Point:
        """Its centre."""
        return Point((self.x1 + self.x2) / 2, (self.y1 + self.y2) / 2)

    def grown(self, by: float) -> Box:
        """Returns a box that is larger on all sides, or smaller if `by` is negative."""
        return Box(self.x1 - by, self.y1 - by, self.x2 + by, self.y2 + by)

    def overlap(self, other: Box) -> tuple[float, float]:
        """Returns width and height of the area that both cover; a negative value is a distance."""
        return (
            min(self.x2, other.x2) - max(self.x1, other.x1),
            min(self.y2, other.y2) - max(self.y1, other.y1),
        )


def box_of(points: Iterable[Point]) -> Box:
    """Returns the smallest box around points."""
    xs, ys = zip(*points, strict=True)
    return Box(min(xs), min(ys), max(xs), max(ys))


def around(boxes: Iterable[Box]) -> Box:
    """Returns the smallest box around boxes."""
    return box_of(point for box in boxes for point in corners(box))


class Transform(NamedTuple):
    """The transformation x' = a*x + c*y + e, y' = b*x + d*y + f."""

    a: float = 1
    b: float = 0
    c: float = 0
    d: float = 1
    e: float = 0
    f: float = 0

    def __call__(self, p: Point) -> Point:
        """Returns the transformed point."""
        return Point(self.a * p.x + self.c * p.y + self.e, self.b * p.x + self.d * p.y + self.f)

    def after(self, first: Transform) -> Transform:
        """Returns the combination of another transformation, then this one."""
        e, f = self(Point(first.e, first.f))
        return Transform(
            self.a * first.a + self.c * first.b,
            self.b * first.a + self.d * first.b,
            self.a * first.c + self.c * first.d,
            self.b * first.c + self.d * first.d,
            e,
            f,
        )

    @property
    def scale(self) -> tuple[float, float]:
        """Factors by which lines along the x axis and the y axis become longer."""
        return math.hypot(self.a, self.b), math.hypot(self.c, self.d)

    @property
    def angle(self) -> float:
        """Direction of the x axis in degrees, in (-90, 90], so that text is not upside down."""
        angle = math.degrees(math.atan2(self.b, self.a)) % 180
        return angle - 180 if angle > 90 + 1e-6 else angle

    def box(self, box: Box) -> Box:
        """Returns the box around the transformed box."""
        return box_of(self(p) for p in corners(box))


def moved(origin: Point, rotation: float = 0) -> Transform:
    """Returns a rotation in degrees, followed by a translation to `origin`."""
    cos, sin = _exact(math.cos(math.radians(rotation))), _exact(math.sin(math.radians(rotation)))
    return Transform(cos, sin, -sin, cos, origin.x, origin.y)


def placed(system: Box, a: Point, b: Point, *, keep_ratio: bool) -> Transform:
    """Returns a transformation that puts a coordinate system into an extent.

    Corners in the opposite order mirror the coordinate system.

    Args:
        system: The extent of the coordinate system.
        a: First corner of the extent.
        b: Opposite corner of the extent.
        keep_ratio: Whether to scale x and y by the same factor.
    """
    sx = (b.x - a.x) / system.width if system.width else 1
    sy = (b.y - a.y) / system.height if system.height else 1
    if keep_ratio:
        scale = min(abs(sx), abs(sy))
        sx, sy = math.copysign(scale, sx), math.copysign(scale, sy)
    centre = system.centre
    return Transform(sx, 0, 0, sy, (a.x + b.x) / 2 - sx * centre.x, (a.y + b.y) / 2 - sy * centre.y)


def _exact(value: float) -> float:
    return round(value) if abs(value - round(value)) < 1e-12 else value


def corners(box: Box) -> tuple[Point, Point, Point, Point]:
    """Returns the corners of a box, in their order around it."""
    return (
        Point(box.x1, box.y1),
        Point(box.x2, box.y1),
        Point(box.x2, box.y2),
        Point(box.x1, box.y2),
    )


@dataclass(frozen=True, slots=True)
class Outline:
    """A curve that consists of lines and cubic Bézier curves.

    Attributes:
        start: First point.
        segments: For a line, its end point; for a cubic curve, two control points and the end
            point.
        closed: Whether the curve returns to the start.
    """

    start: Point
    segments: tuple[tuple[Point, ...], ...]
    closed: bool = False

    def transformed(self, by: Transform) -> Outline:
        """Returns the transformed curve."""
        return Outline(
            by(self.start),
            tuple(tuple(by(p) for p in segment) for segment in self.segments),
            self.closed,
        )

    @property
    def points(self) -> list[Point]:
        """All points of the curve, including control points."""
        return [self.start, *(p for segment in self.segments for p in segment)]


def polyline(points: Sequence[Point], *, closed: bool = False) -> Outline:
    """Returns straight lines between points."""
    return Outline(points[0], tuple((p,) for p in points[1:]), closed)


def bezier(points: Sequence[Point], *, closed: bool = False) -> Outline:
    """Returns the smooth curve that the Modelica specification defines.

    It consists of quadratic curves, which meet in the middles of the lines between the points.
    """
    if len(points) < 3:
        return polyline(points, closed=closed)
    if closed:
        ring = points[:-1] if points[0] == points[-1] else list(points)
        start = _between(ring[-1], ring[0], 0.5)
        ends = [_between(p, q, 0.5) for p, q in zip(ring, [*ring[1:], ring[0]], strict=True)]
        return _quadratic(start, ring, ends, closed=True)
    inner = points[1:-1]
    ends = [_between(p, q, 0.5) for p, q in pairwise(inner)]
    return _quadratic(points[0], inner, [*ends, points[-1]], closed=False)


def _quadratic(
    start: Point, controls: Sequence[Point], ends: Sequence[Point], *, closed: bool
) -> Outline:
    segments = []
    previous = start
    for control, end in zip(controls, ends, strict=True):
        segments.append((_between(previous, control, 2 / 3), _between(end, control, 2 / 3), end))
        previous = end
    return Outline(start, tuple(segments), closed)


def _between(p: Point, q: Point, part: float) -> Point:
    return Point(p.x + (q.x - p.x) * part, p.y + (q.y - p.y) * part)


def rounded(box: Box, radius: float) -> Outline:
    """Returns a rectangle with round corners."""
    r = min(radius, box.width / 2, box.height / 2)
    if r <= 0:
        return polyline(corners(box), closed=True)
    c = r * 0.4477  # distance of a control point from the corner, for a quarter of a circle
    x1, y1, x2, y2 = box
    return Outline(
        Point(x1 + r, y1),
        (
            (Point(x2 - r, y1),),
            (Point(x2 - c, y1), Point(x2, y1 + c), Point(x2, y1 + r)),
            (Point(x2, y2 - r),),
            (Point(x2, y2 - c), Point(x2 - c, y2), Point(x2 - r, y2)),
            (Point(x1 + r, y2),),
            (Point(x1 + c, y2), Point(x1, y2 - c), Point(x1, y2 - r)),
            (Point(x1, y1 + r),),
            (Point(x1, y1 + c), Point(x1 + c, y1), Point(x1 + r, y1)),
        ),
        closed=True,
    )


def arc(box: Box, start: float, end: float) -> Outline:
    """Returns the part of an ellipse between two angles in degrees."""
    pieces = max(1, math.ceil(abs(end - start) / 90 - 1e-9))
    step = math.radians(end - start) / pieces
    k = 4 / 3 * math.tan(step / 4)
    rx, ry, centre = box.width / 2, box.height / 2, box.centre

    def at(angle: float, tangent: float = 0) -> Point:
        cos, sin = math.cos(angle), math.sin(angle)
        return Point(centre.x + rx * (cos - tangent * sin), centre.y + ry * (sin + tangent * cos))

    first = math.radians(start)
    angles = [first + step * n for n in range(pieces + 1)]
    segments = tuple((at(a, k), at(b, -k), at(b)) for a, b in pairwise(angles))
    return Outline(at(first), segments)
