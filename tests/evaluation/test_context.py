"""What a controller knows before the first step."""

import numpy as np
import pytest

from tests.cityflow_files import grid_flows, grid_roadnet, write
from tsc_missing.config import MissingSettings, RunSettings
from tsc_missing.demand.trips import Demand, Trip, turning_flows
from tsc_missing.evaluation.closed_loop import UNCOUNTED, control_context
from tsc_missing.evaluation.run import Options, prepare
from tsc_missing.network.importing import import_cityflow


def flows(net, horizon):
    settings = RunSettings(net=str(net), horizon=horizon, controller="fixed-time")
    scene = prepare(settings, Options()).scene
    plain = turning_flows(scene.demand.trips, scene.network, horizon)
    return control_context(scene, settings).turning_flows, plain


@pytest.mark.parametrize("net", ["jinan_1", "small"])
def test_turning_flows_are_a_mean_over_the_time_with_demand(net, small_net):
    hours = 3600 if net == "jinan_1" else 600
    net = small_net if net == "small" else net
    whole, plain = flows(net, hours)
    np.testing.assert_array_equal(whole, plain)
    np.testing.assert_array_equal(*flows(net, hours // 2))
    longer, plain = flows(net, 2 * hours)
    np.testing.assert_array_equal(longer, whole)
    np.testing.assert_allclose(2 * plain, whole)


def test_without_turning_counts_all_lanes_are_alike():
    told = []
    for seed, volume in ((0, 0.5), (1, 1.0)):
        settings = RunSettings(net="jinan", turning_counts="none", seed=seed, volume=volume)
        scene = prepare(settings, Options()).scene
        context = control_context(scene, settings)
        assert not context.counted
        np.testing.assert_array_equal(
            context.turning_flows, UNCOUNTED * scene.network.slot_lane_count
        )
        told.append(context.turning_flows)
    np.testing.assert_array_equal(*told)


def test_an_import_that_read_beyond_the_end_of_its_flow(tmp_path):
    files = write(tmp_path, grid_roadnet(1, 2), grid_flows(1, 2))
    import_cityflow(*files, tmp_path / "net", "net", 7200)
    _, hour = flows(tmp_path / "net", 3600)
    np.testing.assert_array_equal(flows(tmp_path / "net", 7200)[0], hour)


@pytest.mark.parametrize(("last", "span"), [(0.0, 3600), (3599.9, 3600), (3600.0, 5400)])
def test_the_span_of_a_demand(last, span):
    trips = (Trip(0.0, ("a", "b")), Trip(last, ("a", "b")))
    assert Demand(trips, "recorded", duration=5400).span == span


def test_what_is_silent_for_all_of_a_short_run_has_a_sensor():
    missing = MissingSettings(pattern="random", rate=0.9)
    settings = RunSettings(net="jinan", horizon=30, missing=missing)
    scene = prepare(settings, Options()).scene
    assert not scene.mask.any(axis=0).all()
    assert control_context(scene, settings).sensors.all()
