"""Plain networks to SUMO nets, through ``netconvert`` (from the ``sumo`` extra)."""

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Set
from pathlib import Path
from xml.sax.saxutils import quoteattr

from tsc_missing.errors import UserError
from tsc_missing.network.compile import read_net, road_conflicts
from tsc_missing.network.plain import Movement, Node, PlainNetwork, Road
from tsc_missing.network.slots import RIGHT_OF_WAY

MIN_RADIUS = 0.5  # [m]; at 0 opposing left turns touch
OPTIONS = (
    "--no-turnarounds",
    "--offset.disable-normalization",
    "--junctions.corner-detail=5",
    "--output.street-names=false",
    "--no-internal-links=false",
    "--check-lane-foes.all=true",
    "--geometry.max-grade.fix=false",
    "--precision=3",
)


def sumo_tool(name: str) -> str:
    """The path of a SUMO program; ``UserError`` says how to install it when it is not there."""
    beside = Path(sys.executable).parent / name
    found = str(beside) if beside.exists() else shutil.which(name)
    if found is None:
        raise UserError(
            "program",
            name,
            "pip install 'tsc-missing[sumo]' brings it",
            verdict="is not installed",
        )
    return found


def write_net(plain: PlainNetwork, target: Path) -> None:
    """Write the plain network as a SUMO net; errors of netconvert become a ``UserError``.

    It is built twice: the first net tells which turns conflict, and the second is given, for
    those, who goes first. Left to itself netconvert makes one of two crossing roads the major
    one, so that right turns from it would not give way.
    """
    with tempfile.TemporaryDirectory() as folder:
        first = Path(folder, "first.net.xml")
        _run_netconvert(plain, (), first)
        _run_netconvert(plain, _right_of_way(plain, road_conflicts(read_net(first))), target)
    strip_header(target)


def _run_netconvert(plain: PlainNetwork, right_of_way: Iterable[str], target: Path) -> None:
    program = sumo_tool("netconvert")
    with tempfile.TemporaryDirectory() as folder:
        files = {name: Path(folder, f"plain.{name}.xml") for name in ("nod", "edg", "con")}
        nodes = [_node(node, plain) for node in plain.nodes.values()]
        files["nod"].write_text(_document("nodes", nodes))
        files["edg"].write_text(_document("edges", map(_edge, plain.roads.values())))
        connections = [*_connections(plain), *right_of_way]
        files["con"].write_text(_document("connections", connections))
        command = [program, "-n", files["nod"], "-e", files["edg"], "-x", files["con"]]
        result = subprocess.run(
            [*map(str, command), "-o", str(target), *OPTIONS], capture_output=True, text=True
        )
        if result.returncode != 0 or not target.exists():
            lines = [line for line in result.stderr.splitlines() if line.startswith("Error")]
            raise UserError("network", target.name, f"netconvert: {'; '.join(lines) or 'failed'}")


def strip_header(target: Path) -> None:
    """Drop netconvert's opening comment, which holds the time and the paths of the call."""
    text = target.read_text(encoding="utf-8")
    start, end = text.find("<!--"), text.find("-->")
    if 0 <= start < end:
        target.write_text(text[:start] + text[end + 3 :].lstrip(), encoding="utf-8")


def _document(root: str, lines: Iterable[str]) -> str:
    body = "\n".join(lines)
    return f"<{root}>\n{body}\n</{root}>\n"


def _node(node: Node, plain: PlainNetwork) -> str:
    kind = "traffic_light" if node.signalised else "priority" if node.movements else "dead_end"
    radius = ""
    if node.stop_distance is not None:
        roads = {move.from_road for move in node.movements} | {m.to_road for m in node.movements}
        half = max((sum(lane.width for lane in plain.roads[r].lanes) for r in roads), default=0.0)
        radius = f' radius="{_metres(max(node.stop_distance - half, MIN_RADIUS))}"'
    name = quoteattr(node.id)
    return f'  <node id={name} x="{_metres(node.x)}" y="{_metres(node.y)}" type="{kind}"{radius}/>'


def _metres(value: float) -> str:
    """To a millimetre, also far from the origin, where projected coordinates are."""
    return f"{round(value, 3):.15g}"


def _edge(road: Road) -> str:
    shape = " ".join(f"{_metres(x)},{_metres(y)}" for x, y in road.shape)
    lanes = "".join(
        f'<lane index="{index}" width="{lane.width:g}" speed="{lane.speed:g}"/>'
        for index, lane in enumerate(road.lanes)
    )
    return (
        f"  <edge id={quoteattr(road.id)} from={quoteattr(road.start)} to={quoteattr(road.end)} "
        f'numLanes="{len(road.lanes)}" shape="{shape}">{lanes}</edge>'
    )


def _connections(plain: PlainNetwork) -> list[str]:
    """All links, and for roads without any that there are none, or netconvert would guess some."""
    ends = {road.id for road in plain.roads.values() if plain.nodes[road.end].movements}
    dead = sorted(ends - {m.from_road for node in plain.nodes.values() for m in node.movements})
    return [f"  <connection from={quoteattr(road)}/>" for road in dead] + [
        f"  <connection from={quoteattr(move.from_road)} to={quoteattr(move.to_road)} "
        f'fromLane="{start}" toLane="{end}"/>'
        for node in plain.nodes.values()
        for move in node.movements
        for start, end in move.lane_pairs
    ]


def _right_of_way(plain: PlainNetwork, conflicts: Set[tuple[str, str, str, str]]) -> Iterator[str]:
    """Straight before left before right, wherever two turns conflict."""
    for node in plain.nodes.values():
        for first in node.movements:
            for second in node.movements:
                pair = (first.from_road, first.to_road, second.from_road, second.to_road)
                if pair in conflicts and RIGHT_OF_WAY[first.turn] < RIGHT_OF_WAY[second.turn]:
                    yield f"  <prohibition prohibitor={_arrow(first)} prohibited={_arrow(second)}/>"


def _arrow(move: Movement) -> str:
    return quoteattr(f"{move.from_road}->{move.to_road}")
