"""SUMO's own actuated signals as programs over the same phases, for comparison."""

from xml.sax.saxutils import quoteattr

from tsc_missing.config import SignalSettings
from tsc_missing.network.model import Network
from tsc_missing.network.records import IntersectionRecord
from tsc_missing.simulation.states import green_state, red_state, sumo_state, yellow_state

ACTUATED = "actuated"
KINDS = (ACTUATED, "delay_based")
AS_BUILT = "as-built"  # the programs that came with the network
RECALL = "actuated-recall"  # "actuated", with detectors that fail (see ``recall``)
PROGRAM_ID = "tsc-native"
MAX_GREEN = 50  # [s], netconvert's default for programs that respond to traffic


def native_program_xml(network: Network, kind: str, signals: SignalSettings) -> str:
    """SUMO's ``tlLogic`` elements, one an intersection, for an additional file.

    ``kind`` is one of ``KINDS``: ``actuated`` prolongs a green while the gaps between vehicles
    are short, ``delay_based`` while vehicles within 100 m (SUMO's default) have lost time; each
    green lasts between the minimum green and 50 s. Phases follow one another in table order.
    """
    return "\n".join(_logic(node, kind, signals) for node in network.intersections)


def _logic(node: IntersectionRecord, kind: str, signals: SignalSettings) -> str:
    lines = [f'<tlLogic id={quoteattr(node.id)} type="{kind}" programID="{PROGRAM_ID}" offset="0">']
    greens = [green_state(node, phase) for phase in range(len(node.phases))]
    least = max(signals.min_green_at(node), 1)  # SUMO has no phase of 0 s
    longest = max(MAX_GREEN, least)
    for before, after in zip(greens, [*greens[1:], greens[0]], strict=True):
        lines.append(
            f'  <phase duration="{least}" minDur="{least}" '
            f'maxDur="{longest}" state="{sumo_state(node, before)}"/>'
        )
        lines += _change(node, before, after, signals)
    return "\n".join([*lines, "</tlLogic>"])


def _change(
    node: IntersectionRecord, before: str, after: str, signals: SignalSettings
) -> list[str]:
    """The yellow and all-red between two greens; nothing if no link turns red."""
    yellow = yellow_state(before, after)
    if "y" not in yellow:
        return []
    states = [(signals.yellow_at(node), yellow)]
    if signals.all_red:
        states.append((signals.all_red, red_state(before, after)))
    return [
        f'  <phase duration="{seconds}" state="{sumo_state(node, state)}"/>'
        for seconds, state in states
    ]
