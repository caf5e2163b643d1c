"""OpenStreetMap extracts to SUMO nets, through ``netconvert``."""

import subprocess
from pathlib import Path
from xml.etree import ElementTree

from tsc_missing.errors import UserError
from tsc_missing.network.netconvert import strip_header, sumo_tool

FIELD = "osm"
OPTIONS = (
    "--geometry.remove",  # no node where a road only bends
    "--ramps.guess",
    "--junctions.join",  # the nodes of one intersection become one
    "--tls.guess-signals",  # signals are mapped at stop lines: they belong to the junction behind
    "--tls.discard-simple",
    "--tls.join",
    "--tls.default-type=static",
    "--no-turnarounds.except-deadend",
    "--no-turnarounds.tls",
    "--keep-edges.by-vclass=passenger",
    "--remove-edges.isolated",
    "--roundabouts.guess",
    "--osm.turn-lanes",
    "--junctions.corner-detail=5",
    "--output.street-names=false",
    "--precision=3",
)


def convert_osm(source: Path, target: Path, left_hand: bool = False) -> None:
    """Write the roads for cars of an OSM extract (.osm, .osm.xml) as a SUMO net.

    With ``left_hand`` traffic drives on the left, of which extracts say nothing.

    Signals that are mapped at stop lines are given to their junction, and junctions that are close
    together are joined. ``UserError`` for files that are none and for extracts without roads.
    """
    _check(source)
    command = [
        sumo_tool("netconvert"),
        f"--osm-files={source}",
        f"--output-file={target}",
        *OPTIONS,
        *(["--lefthand"] if left_hand else []),
    ]
    result = subprocess.run(command, capture_output=True, text=True)
    if result.returncode != 0 or not target.exists():
        lines = [line.strip() for line in result.stderr.splitlines() if line.startswith("Error")]
        words = " ".join(" ".join(lines).removeprefix("Error:").split())
        raise UserError(FIELD, source, f"netconvert: {words or 'failed'}")
    strip_header(target)


def _check(source: Path) -> None:
    """Raise ``UserError`` unless it is OSM's XML with roads in it."""
    roads = False
    root = ""
    try:
        for event, element in ElementTree.iterparse(source, events=("start", "end")):
            root = root or element.tag
            if event == "end" and element.tag == "way":
                roads = roads or any(tag.get("k") == "highway" for tag in element.iter("tag"))
                element.clear()
    except OSError as error:
        raise UserError(FIELD, source, f"the file cannot be read ({error.strerror})") from None
    except ElementTree.ParseError as error:
        raise UserError(FIELD, source, f"it must be OSM's XML ({error})") from None
    if root != "osm":
        raise UserError(FIELD, source, f"it must be OSM's XML, not <{root}>")
    if not roads:
        raise UserError(FIELD, source, "there is no road (a way with the tag highway) in it")
