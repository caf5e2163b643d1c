"""Pictures of networks: what is drawn is what the network and the mask say."""

import dataclasses
import gzip
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.backends.backend_agg import FigureCanvasAgg

from tests.networks import grid_network, tee_network
from tsc_missing.config import MissingSettings
from tsc_missing.errors import UserError
from tsc_missing.network.coverage import Coverage
from tsc_missing.network.folder import read_folder
from tsc_missing.network.picture import draw_network, save_picture
from tsc_missing.network.picture_legend import round_length
from tsc_missing.network.picture_marks import lane_shares
from tsc_missing.network.picture_names import common_prefix
from tsc_missing.network.roads import Road, band, beside, lane_offsets, last_part, read_roads
from tsc_missing.network.summary import summarise_network, summarise_sensors
from tsc_missing.sensing.patterns import draw_mask


@pytest.fixture(scope="module")
def small(small_net):
    folder = read_folder(small_net, "small")
    return folder.network, read_roads(folder.net_file, folder.network.record)


def grid_roads(network):
    """The roads of a grid of ``tests.networks``, straight between its nodes."""
    lanes = {}
    for lane, record in network.record.lanes.items():
        lanes.setdefault(record.road, []).append(lane)
    places = {}
    step = np.array([400.0, 800.0])  # columns, rows
    for road in lanes:
        r0, c0, r1, c1 = map(int, re.findall(r"\d+", road))
        places[road] = np.array([[c0, r0], [c1, r1]]) * step
    return [
        Road(road, places[road], tuple(sorted(names)), True, 1, not network.record.upstream[road])
        for road, names in sorted(lanes.items())
    ]


def coverage_of(network, mask):
    return Coverage.of_mask(mask | ~network.slot_mask, network.slot_mask)


def drawn(figure, gid):
    """The collection with that id, or None."""
    return next((artist for artist in figure.axes[0].collections if artist.get_gid() == gid), None)


def places(figure, gid):
    collection = drawn(figure, gid)
    return [] if collection is None else collection.get_offsets().tolist()


def legend_words(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


# Roads


def test_roads_lie_between_their_junctions(small):
    network, roads = small
    spacing = {200.0, 300.0}
    assert {lane for road in roads for lane in road.lanes} == set(network.record.lanes)
    assert all(road.two_way and road.out == 1 and len(road.lanes) == 3 for road in roads)
    assert {float(np.hypot(*(road.line[-1] - road.line[0]))) for road in roads} == spacing
    ends = {road.id: road.line[-1].tolist() for road in roads}
    for node in network.intersections:
        assert all(ends[road] == [node.x, node.y] for road in node.roads)
    assert {road.id for road in roads if road.entry} == {
        road for road, feeders in network.record.upstream.items() if not feeders
    }


def test_a_gzipped_net_gives_the_same_roads(small, small_net, tmp_path):
    network, roads = small
    packed = tmp_path / "net.net.xml.gz"
    packed.write_bytes(gzip.compress((small_net / "net.net.xml").read_bytes()))
    for plain, other in zip(roads, read_roads(packed, network.record), strict=True):
        assert np.array_equal(plain.line, other.line)
        assert dataclasses.replace(plain, line=None) == dataclasses.replace(other, line=None)


def test_traffic_on_the_left_is_found_from_the_geometry(small, small_net, tmp_path):
    def mirrored(match):
        points = (point.split(",") for point in match[1].split())
        return f'shape="{" ".join(f"{x},{-float(y)}" for x, y in points)}"'

    text = re.sub(r'shape="([^"]*)"', mirrored, (small_net / "net.net.xml").read_text())
    (tmp_path / "left.net.xml").write_text(re.sub(r' y="([^"]*)"', r' y="-\1"', text))
    roads = read_roads(tmp_path / "left.net.xml", small[0].record)
    assert all(road.out == -1 for road in roads)
    assert np.all(lane_offsets(roads[0], 3.0, 1.0) < 0)


def test_lanes_of_two_way_roads_lie_on_their_side_and_of_one_way_roads_in_the_middle():
    road = Road("r", np.array([[0.0, 0.0], [100.0, 0.0]]), ("a", "b", "c"), True, 1, False)
    assert lane_offsets(road, 2.0, 1.0).tolist() == [5.5, 3.5, 1.5]
    one_way = dataclasses.replace(road, two_way=False)
    assert lane_offsets(one_way, 2.0, 1.0).tolist() == [2.0, 0.0, -2.0]
    assert lane_offsets(dataclasses.replace(one_way, out=-1), 2.0, 1.0).tolist() == [-2.0, 0.0, 2.0]


def test_polylines_beside_a_corner_keep_their_distance():
    line = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    assert beside(line, 1.0).tolist() == [[0, -1], [11, -1], [11, 10]]
    assert beside(line, -1.0).tolist() == [[0, 1], [9, 1], [9, 10]]
    assert len(band(line, 1.0, 2.0)) == 6


def test_the_last_part_of_a_polyline():
    line = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    assert last_part(line, 12.0, 3.0).tolist() == [[8, 0], [10, 0], [10, 7]]
    assert last_part(line, 99.0, 0.0).tolist() == line.tolist()


# Coverage and summary


def test_coverage_leaves_absent_slots_out():
    network = tee_network()
    mask = np.ones((4, network.n, 12), dtype=bool)
    mask[:, 0] = False
    mask[:2, 1] = False
    mask[:, 2, 0] = False
    tee = network.ids.index("n_2_2")
    mask[:, tee] = False
    coverage = coverage_of(network, mask)
    assert np.flatnonzero(coverage.blind).tolist() == sorted({0, tee})
    assert np.flatnonzero(coverage.partly).tolist() == [1, 2]
    assert np.flatnonzero(coverage.uneven).tolist() == [2]
    assert coverage.intersections[1] == 0.5
    assert coverage.intersections[2] == pytest.approx(1 / 12)
    assert coverage.never.sum() == network.slot_mask[[0, tee]].sum() + 1
    assert coverage.share == pytest.approx(1 - mask[:, network.slot_mask].mean())


def test_the_summary_counts_the_network():
    network = tee_network()
    summary = summarise_network(network, grid_roads(network))
    assert summary.intersections == 6
    assert summary.slots_present == network.slot_mask.sum()
    assert summary.slots_present + summary.slots_absent == 6 * 12
    assert summary.roads == len({lane.road for lane in network.record.lanes.values()})
    assert summary.boundary_entries == 9
    assert summary.lane_length == pytest.approx(3 * summary.road_length)
    assert [kind.intersections for kind in summary.signals] == [5, 1]
    phases = {phase.name: phase.slots for phase in summary.signals[0].phases}
    assert phases["WT_ET"] == ("E-straight", "W-straight")
    assert summary.signals[0].always_green == ("N-right", "E-right", "S-right", "W-right")


def test_the_summary_names_what_is_never_observed():
    network = grid_network(1, 3)
    mask = np.ones((5, 3, 12), dtype=bool)
    mask[:, 1] = False
    sensors = summarise_sensors(coverage_of(network, mask), network.ids, "here", 5)
    assert sensors.never_observed == ("n_1_2",)
    assert (sensors.partly_observed, sensors.slots_never_observed) == (0, 12)
    assert sensors.missing_share == pytest.approx(1 / 3, abs=1e-6)


# Marks


def test_without_a_mask_every_intersection_has_the_same_mark(small):
    network, roads = small
    figure = draw_network(network, roads, "small")
    assert places(figure, "intersections") == network.coordinates.tolist()
    assert len(drawn(figure, "roads").get_paths()) == len(roads)
    assert legend_words(figure) == [
        "road, a band for each direction",
        "intersection with signals (6)",
    ]


@settings(max_examples=15)
@given(st.integers(0, 2**32), st.sampled_from(["random", "kriging", "lane", "burst", "mixed"]))
def test_marks_are_those_of_the_mask(seed, pattern):
    network = tee_network()
    mask = draw_mask(MissingSettings(pattern=pattern, rate=0.4), network, 6, seed)
    coverage = coverage_of(network, mask)
    figure = draw_network(network, grid_roads(network), "tee", coverage=coverage)
    at = network.coordinates
    share = (~mask).sum(axis=(0, 2)) / (6 * network.slot_mask.sum(axis=1))
    seen, blind = share == 0, share == 1
    assert places(figure, "always-observed") == at[seen].tolist()
    assert places(figure, "never-observed") == at[blind].tolist()
    assert places(figure, "never-observed-crosses") == at[blind].tolist()
    assert places(figure, "partly-observed") == at[~seen & ~blind].tolist()
    if (~seen & ~blind).any():
        colours = drawn(figure, "partly-observed").get_array()
        assert np.allclose(colours, share[~seen & ~blind])
        assert "colour bar" in [axes.get_label() for axes in figure.axes]
    else:
        assert [axes.get_label() for axes in figure.axes] == ["map"]
    words = legend_words(figure)
    for which, name in ((seen, "always"), (~seen & ~blind, "partly"), (blind, "never")):
        assert (f"{name} observed ({which.sum()})" in words) == bool(which.any())


def test_lanes_are_drawn_where_slots_of_an_intersection_differ(small):
    network, roads = small
    mask = np.ones((10, network.n, 12), dtype=bool)
    mask[:, 0, 3] = False  # never reports
    mask[:4, 0, 4] = False
    mask[:5, 1] = False  # all slots alike
    mask[:, 2] = False
    coverage = coverage_of(network, mask)
    figure = draw_network(network, roads, "small", coverage=coverage)
    lanes = drawn(figure, "lanes")
    assert sorted(lanes.get_array()) == [0.0] * 10 + [0.4]
    never = drawn(figure, "lanes-never-observed")
    assert len(never.get_paths()) == 1
    assert never.get_hatch()
    assert "lane that never reports" in legend_words(figure)
    (lane,) = network.slot_lanes[0][3]
    assert lane_shares(network, coverage)[lane] == 1.0
    middle = never.get_paths()[0].vertices[:-1].mean(axis=0)
    road = next(road for road in roads if lane in road.lanes)
    along = np.dot(road.line[-1] - middle, road.line[-1] - road.line[0])
    assert 0 < along < 0.5 * np.dot(*[road.line[-1] - road.line[0]] * 2)


def test_lanes_are_not_drawn_where_all_slots_are_alike(small):
    network, roads = small
    mask = draw_mask(MissingSettings(pattern="burst", rate=0.5), network, 40, 1)
    figure = draw_network(network, roads, "small", coverage=coverage_of(network, mask))
    assert drawn(figure, "lanes") is None
    assert not any("lane" in words for words in legend_words(figure))


# The page


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 12), (3, 16), (16, 3), (12, 1)])
def test_the_map_is_to_scale_whole_and_of_a_sensible_size(rows, columns):
    network = grid_network(rows, columns)
    mask = draw_mask(MissingSettings(pattern="mixed", rate=0.5), network, 40, 1)
    roads = grid_roads(network)
    figure = draw_network(network, roads, "grid", "words " * 30, coverage_of(network, mask))
    axes = figure.axes[0]
    width, height = figure.get_size_inches() * axes.get_position().size
    assert width / np.ptp(axes.get_xlim()) == pytest.approx(height / np.ptp(axes.get_ylim()))
    for road in roads:
        assert np.all((road.line >= [axes.get_xlim()[0], axes.get_ylim()[0]]).all())
        assert np.all((road.line <= [axes.get_xlim()[1], axes.get_ylim()[1]]).all())
    assert figure.get_size_inches().min() > 3.5
    assert figure.get_size_inches().max() < 14


def boxes(figure, texts):
    renderer = FigureCanvasAgg(figure).get_renderer()
    return [text.get_window_extent(renderer) for text in texts]


@pytest.mark.parametrize("labels", [False, True])
@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 12), (16, 3)])
def test_nothing_beside_the_map_overlaps(rows, columns, labels):
    network = grid_network(rows, columns)
    mask = draw_mask(MissingSettings(pattern="mixed", rate=0.5), network, 40, 1)
    figure = draw_network(
        network, grid_roads(network), "grid", "words " * 30, coverage_of(network, mask), labels
    )
    figure.canvas.draw()
    texts = [text for text in figure.texts if text.get_gid() != "name"]
    legend = figure.legends[0].get_window_extent()
    colours = next(a for a in figure.axes if a.get_label() == "colour bar").get_tightbbox()
    bar = next(a for a in figure.artists if a.get_gid() == "scale-bar").get_window_extent()
    parts = [figure.axes[0].get_window_extent(), legend, colours, bar, *boxes(figure, texts)]
    for k, part in enumerate(parts):
        assert figure.bbox.x0 <= part.x0
        assert part.x1 <= figure.bbox.x1
        assert figure.bbox.y0 <= part.y0
        assert part.y1 <= figure.bbox.y1
        assert not any(part.overlaps(other) for other in parts[:k])


@pytest.mark.parametrize(("rows", "columns"), [(2, 2), (16, 3), (8, 8)])
def test_names_overlap_neither_each_other_nor_the_marks(rows, columns):
    network = grid_network(rows, columns)
    figure = draw_network(network, grid_roads(network), "grid", names=True)
    names = [text for text in figure.texts if text.get_gid() == "name"]
    assert [text.get_text() for text in names] == list(network.ids)
    around = boxes(figure, names)
    for k, box in enumerate(around):
        assert not any(box.overlaps(other) for other in around[:k])
    marks = drawn(figure, "intersections")
    radius = np.sqrt(marks.get_sizes()) / 2 * figure.dpi / 72
    centres = figure.axes[0].transData.transform(network.coordinates)
    for box in around:
        nearest = np.clip(centres, box.min, box.max)
        assert np.all(np.hypot(*(nearest - centres).T) > 0.9 * radius)


def test_names_too_long_for_the_map_lose_what_they_share_and_the_legend_says_so():
    network = grid_network(2, 12)
    long = network.record.model_dump()
    for node in long["intersections"]:
        node["id"] = f"a_very_long_name_for_an_intersection_{node['id']}"
    long["upstream"] = {}
    renamed = type(network)("long", type(network.record).model_validate(long))
    figure = draw_network(renamed, grid_roads(network), "x", names=True)
    names = [text.get_text() for text in figure.texts if text.get_gid() == "name"]
    assert names == [f"{row}_{column}" for row in (1, 2) for column in range(1, 13)]
    assert "names without “a_very_long_name_for_an_intersection_n_”" in legend_words(figure)


@pytest.mark.parametrize(
    ("names", "prefix"),
    [
        (["node_1", "node_2"], "node_"),
        (["node_1"], ""),
        (["a_1", "a_2"], ""),
        (["node12", "node13"], ""),
        (["node_", "node_2"], ""),
        (["cluster_1_2", "cluster_1_3"], "cluster_1_"),
    ],
)
def test_what_names_share(names, prefix):
    assert common_prefix(names) == prefix


def test_names_with_dollar_signs_are_no_formulas(small):
    network, roads = small
    figure = draw_network(network, roads, "a$b$ {", "cost $1 and $2", names=True)
    figure.canvas.draw()
    assert "a$b$ {" in [text.get_text() for text in figure.texts]


@pytest.mark.parametrize(("most", "length"), [(1, 1), (9.99, 5), (499, 200), (500, 500)])
def test_scale_bars_have_round_lengths(most, length):
    assert round_length(most) == pytest.approx(length)


# Files


@pytest.mark.parametrize(
    ("suffix", "start"), [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".PDF", b"%PDF")]
)
def test_the_same_picture_is_the_same_file(small, tmp_path, suffix, start):
    network, roads = small
    mask = draw_mask(MissingSettings(pattern="mixed", rate=0.5), network, 40, 1)
    written = []
    for name in "ab":
        figure = draw_network(network, roads, "small", "", coverage_of(network, mask), True)
        save_picture(figure, tmp_path / f"{name}{suffix}", "out")
        written.append((tmp_path / f"{name}{suffix}").read_bytes())
    assert written[0] == written[1]
    assert written[0].startswith(start)
    assert len(list(tmp_path.iterdir())) == 2


def test_a_picture_that_cannot_be_written_leaves_nothing_and_keeps_the_old_one(
    small, tmp_path, monkeypatch
):
    network, roads = small
    figure = draw_network(network, roads, "small")
    (tmp_path / "x.png").write_text("old")

    def full(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(figure, "savefig", full)
    with pytest.raises(UserError, match="No space left"):
        save_picture(figure, tmp_path / "x.png", "out")
    assert [path.name for path in tmp_path.iterdir()] == ["x.png"]
    assert (tmp_path / "x.png").read_text() == "old"
