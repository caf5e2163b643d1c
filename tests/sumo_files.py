"""SUMO and OSM files for tests: stars of roads around one signal, and a small town."""

import math
import subprocess
from collections.abc import Sequence
from pathlib import Path

from tsc_missing.network.netconvert import sumo_tool


def star(
    folder: Path,
    bearings: Sequence[float],
    lanes: int | Sequence[int] = 1,
    kind: str = "traffic_light",
    options: Sequence[str] = (),
    sidewalk: bool = False,
    turning_back: bool = False,
) -> Path:
    """A net of two-way roads of 300 m that meet at a signal ``c``, given where they lie.

    Road ``in_k`` comes from the k-th bearing [degrees], ``out_k`` goes there, from ``in_k`` only
    with ``turning_back``.
    """
    counts = [lanes] * len(bearings) if isinstance(lanes, int) else lanes
    places = [(300 * math.sin(math.radians(b)), 300 * math.cos(math.radians(b))) for b in bearings]
    walk = ' sidewalkWidth="2"' if sidewalk else ""
    nodes = [f'<node id="c" x="0" y="0" type="{kind}"/>'] + [
        f'<node id="n{k}" x="{x:.2f}" y="{y:.2f}" type="dead_end"/>'
        for k, (x, y) in enumerate(places)
    ]
    edges = [
        f'<edge id="{name}_{k}" from="{start}" to="{end}" numLanes="{count}" speed="13.89"{walk}/>'
        for k, count in enumerate(counts)
        for name, start, end in (("in", f"n{k}", "c"), ("out", "c", f"n{k}"))
    ]
    files = {"nod": ("nodes", nodes), "edg": ("edges", edges)}
    for suffix, (root, lines) in files.items():
        body = "\n".join(lines)
        (folder / f"star.{suffix}.xml").write_text(f"<{root}>\n{body}\n</{root}>\n")
    target = folder / "star.net.xml"
    command = [sumo_tool("netconvert"), "-n", "star.nod.xml", "-e", "star.edg.xml"]
    more = ["-o", target.name, f"--no-turnarounds={str(not turning_back).lower()}", *options]
    subprocess.run([*command, *more], cwd=folder, check=True, capture_output=True)
    return target


def write_routes(path: Path, *elements: str) -> Path:
    """A SUMO route file of these elements."""
    path.write_text("<routes>\n" + "\n".join(elements) + "\n</routes>\n")
    return path


def town(path: Path, signals: bool = True, highway: bool = True) -> Path:
    """An OSM extract: two crossing streets and a side street, about 500 m across."""
    step = 0.0025  # degrees, about 278 m north-south
    places = {
        1: (0, -1), 2: (0, 0), 3: (0, 1),
        4: (-1, 0), 5: (1, 0),
        6: (-1, 1), 7: (1, 1),
    }  # fmt: skip
    light = '<tag k="highway" v="traffic_signals"/>' if signals else ""
    nodes = [
        f'<node id="{k}" version="1" lat="{50 + y * step:.6f}" lon="{8 + x * step:.6f}">'
        f"{light if k in (2, 3) else ''}</node>"
        for k, (x, y) in places.items()
    ]
    road = "highway" if highway else "building"
    ways = [
        f'<way id="{10 + k}" version="1">{"".join(f"""<nd ref="{n}"/>""" for n in way)}'
        f'<tag k="{road}" v="{kind}"/><tag k="lanes" v="{lanes}"/></way>'
        for k, (way, kind, lanes) in enumerate(
            [((1, 2, 3), "primary", 4), ((4, 2, 5), "secondary", 2), ((6, 3, 7), "residential", 2)]
        )
    ]
    body = "\n".join([*nodes, *ways])
    path.write_text(
        f'<?xml version="1.0" encoding="UTF-8"?>\n<osm version="0.6">\n{body}\n</osm>\n'
    )
    return path
