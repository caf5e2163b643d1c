"""Intersections' names in a picture, beside their marks and never one over another."""

import re
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.path import Path as Outline
from matplotlib.patheffects import withStroke
from matplotlib.transforms import Bbox, BboxBase

from tsc_missing.network.model import FloatArray
from tsc_missing.network.picture_style import INK, WHITE

SIZES = tuple(np.arange(9.0, 5.9, -0.5).tolist())  # [points]
SMALL_SIZES = (5.5, 5.0, 4.5)
OVERHANG = 0.22  # [inches], that names may stand out of the map
CORNERS = ((1, 1), (-1, 1), (1, -1), (-1, -1))  # right and above the mark first

Place = tuple[float, float, int, int]  # x, y [pixels], and the corner of the mark


class Obstacles:
    """Areas of the picture [pixels] that a name may not touch."""

    def __init__(self, outlines: Sequence[FloatArray]) -> None:
        self._outlines = [Outline(outline) for outline in outlines]
        boxes = [(*o.min(axis=0), *o.max(axis=0)) for o in outlines]
        self._boxes: FloatArray = np.array(boxes, dtype=np.float64).reshape(-1, 4)

    def touch(self, box: Bbox) -> bool:
        """Whether any of them and the box overlap."""
        low, high = self._boxes[:, :2], self._boxes[:, 2:]
        near = np.all((low < box.max) & (high > box.min), axis=1)
        return any(self._outlines[k].intersects_bbox(box) for k in np.flatnonzero(near))


def draw_names(
    figure: Figure,
    axes: Axes,
    names: Sequence[str],
    places: FloatArray,
    radius: FloatArray,
    roads: Sequence[FloatArray],
) -> str:
    """Write the names of the marks at ``places`` (N, 2) [m] with ``radius`` (N,) [m].

    All are of one size, the largest at which they keep clear of each other, of the marks and of
    the ``roads``' outlines [m]. Where that is impossible the part that all names begin with is
    left out, then some lie on roads, then they get smaller, and at last some are left out.
    Returns what a reader has to know of it, or nothing.
    """
    centres = axes.transData.transform(places)
    reach = axes.transData.transform(np.c_[places[:, 0] + radius, places[:, 1]])[:, 0]
    reach = reach - centres[:, 0]
    squares = [_square(centre, r) for centre, r in zip(centres, reach, strict=True)]
    clear = Obstacles([*squares, *map(axes.transData.transform, roads)])
    prefix = common_prefix(names)
    short = [name.removeprefix(prefix) for name in names]
    marks = Obstacles(squares)
    page = axes.bbox.padded(OVERHANG * figure.dpi)
    full_boxes, short_boxes = (_text_sizes(figure, shown) for shown in (names, short))
    attempts = [
        *((list(names), full_boxes, size, (clear,)) for size in SIZES),
        *((short, short_boxes, size, (clear,)) for size in SIZES),
        *((short, short_boxes, size, (clear, marks)) for size in (*SIZES, *SMALL_SIZES)),
    ]
    for shown, boxes, size, obstacles in attempts:
        found = _arrange(page, centres, reach, boxes * size, obstacles)
        best = shown, found, size
        if None not in found:
            break
    shown, found, size = best
    _write(figure, shown, found, size)
    return _note(prefix if shown is short else "", found.count(None))


def common_prefix(names: Sequence[str]) -> str:
    """What all names begin with, up to a separator; nothing if that is short."""
    first, last = min(names), max(names)  # what these two share, all between them share
    length = next(
        (k for k, pair in enumerate(zip(first, last, strict=False)) if len({*pair}) > 1), 0
    )
    end = re.search(r".*[_\-/:.# ]", first[:length])
    return end.group() if end and len(end.group()) > 2 else ""


def _square(centre: FloatArray, reach: float) -> FloatArray:
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    outline: FloatArray = centre + 0.95 * reach * corners
    return outline


def _text_sizes(figure: Figure, names: Sequence[str]) -> FloatArray:
    """(N, 2): width and height of each name [pixels] for a letter size of one point."""
    probe = figure.text(0, 0, "", size=SIZES[0], parse_math=False)
    extents = []
    for name in names:
        probe.set_text(name)
        box = probe.get_window_extent()
        extents.append((box.width + 1, box.height + 1))
    probe.remove()
    sizes: FloatArray = np.array(extents) / SIZES[0]
    return sizes


def _arrange(
    page: BboxBase,
    centres: FloatArray,
    reach: FloatArray,
    sizes: FloatArray,
    obstacles: Sequence[Obstacles],
) -> list[Place | None]:
    """A place for each name, as far as there is room on the ``page`` [pixels].

    It keeps clear of the first of the ``obstacles`` where it can, and else of the next.
    """
    taken: list[Bbox] = []
    found: list[Place | None] = []
    for centre, r, size in zip(centres, reach, sizes, strict=True):
        places = [(*(centre + (r + 1) * np.array(corner)), *corner) for corner in CORNERS]
        boxes = [_box(place, size) for place in places]
        free = [
            k
            for tier in obstacles
            for k, box in enumerate(boxes)
            if page.containsx(box.x0)
            and page.containsx(box.x1)
            and page.containsy(box.y0)
            and page.containsy(box.y1)
            and not any(box.overlaps(other) for other in taken)
            and not tier.touch(box)
        ]
        taken += [boxes[k] for k in free[:1]]
        found.append(places[free[0]] if free else None)
    return found


def _box(place: Place, size: FloatArray) -> Bbox:
    """The box [pixels] of a name of that width and height at a place."""
    x, y, right, up = place
    ends = (x, x + right * size[0]), (y, y + up * size[1])
    return Bbox.from_extents(min(ends[0]), min(ends[1]), max(ends[0]), max(ends[1]))


def _write(
    figure: Figure, names: Sequence[str], places: Sequence[Place | None], size: float
) -> None:
    for name, place in zip(names, places, strict=True):
        if place is None:
            continue
        x, y, right, up = place
        figure.text(
            x / figure.bbox.width,
            y / figure.bbox.height,
            name,
            size=size,
            color=INK,
            ha="left" if right > 0 else "right",
            va="bottom" if up > 0 else "top",
            parse_math=False,
            gid="name",
            path_effects=[withStroke(linewidth=1.5, foreground=WHITE)],
        )


def _note(prefix: str, left_out: int) -> str:
    notes = [f"names without “{prefix}”"] if prefix else []
    if left_out:
        notes.append(f"{left_out} {'names' if left_out > 1 else 'name'} left out, no room")
    return "; ".join(notes)
