import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("torch", reason="the diffusion controller needs torch")

import torch

from tests.controllers.helpers import A, B, cross_and_tee
from tests.controllers.planning import (
    STEPS,
    observations,
    reorder_noise,
    reordered,
    save_broken,
    save_tiny,
    taken,
)
from tests.networks import context_for, grid_network, tee_network
from tsc_missing.config import RunSettings
from tsc_missing.controllers import planner
from tsc_missing.controllers.check import check_controller
from tsc_missing.controllers.difflight import DiffLight, best_finite, nothing_known
from tsc_missing.controllers.fallback import Safe
from tsc_missing.controllers.planner import Planner
from tsc_missing.controllers.recent import RecentSteps
from tsc_missing.controllers.registry import controller_of
from tsc_missing.controllers.rolling_horizon import HorizonPlans
from tsc_missing.errors import UserError
from tsc_missing.qlearning.controller import PhaseValues
from tsc_missing.qlearning.networks import PhaseValue
from tsc_missing.qlearning.weights import save_q_network
from tsc_missing.weights import find

SCORINGS = pytest.mark.parametrize("scoring", ["inverse", "queue", "mixed", "value", "horizon"])
GRID = grid_network(2, 3)


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    return save_tiny(tmp_path_factory.mktemp("weights") / find.FILE)


@pytest.fixture(scope="module")
def values(tmp_path_factory):
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("values") / find.FILE
    save_q_network(PhaseValue(8), "value", 8, path, {})
    return path


@pytest.fixture
def make(weights, values):
    """DiffLight by its scoring."""

    def made(scoring, steps, diffusion=weights):
        return DiffLight(
            diffusion, steps, scoring, [values] if scoring in ("value", "blend") else []
        )

    return made


@pytest.fixture
def controller(weights):
    return DiffLight(weights, sampling_steps=3)


def run(controller, network, seed=0, poison=None):
    """(STEPS, N) phases and (STEPS, N, 12, F) estimates."""
    controller.reset(context_for(network, seed))
    steps = [
        (controller.decide(observation), controller.estimates())
        for observation in observations(network, poison)
    ]
    return tuple(np.array(column) for column in zip(*steps, strict=True))


def test_nothing_is_known_where_no_slot_that_is_there_reported():
    network = cross_and_tee()
    known = np.zeros((network.n, 5, 12), dtype=bool)
    known[A, 3, 4] = True
    absent = ~network.slot_mask[:, None].repeat(5, axis=1)
    assert absent[B].any()
    found = nothing_known(known | absent, network.slot_mask)
    assert found[[A, B]].tolist() == [False, True]


def test_the_values_are_told_what_was_seen(make, monkeypatch):
    told = []
    plain = PhaseValues.of

    def watched(self, values, red_steps, known=None):
        told.append(known)
        return plain(self, values, red_steps, known)

    monkeypatch.setattr(PhaseValues, "of", watched)
    controller = make("value", 1)
    run(controller, GRID)
    seen = [observation.mask for observation in observations(GRID)]
    assert not all(mask.all() for mask in seen)
    assert len(told) == len(seen)
    for step in range(4, len(seen)):
        window = np.stack(seen[step - 4 : step + 1])
        hidden = ~(window & GRID.slot_mask).any(axis=(0, 2))
        assert (told[step][:, 0] == (window | hidden[None, :, None])).all()


@SCORINGS
def test_it_conforms(make, scoring):
    check_controller(lambda: make(scoring, 1), cross_and_tee())


@SCORINGS
@pytest.mark.parametrize("network", [GRID, tee_network(), grid_network(1, 1)])
def test_phases_are_those_of_the_network_and_all_is_filled(make, scoring, network):
    phases, estimates = run(make(scoring, 2), network)
    assert network.phase_mask[np.arange(network.n), phases].all()
    assert np.isfinite(estimates).all()
    assert (estimates >= 0).all()
    assert not estimates[:, ~network.slot_mask].any()


@pytest.mark.parametrize("poison", [1e9, -np.inf, 0.0])
def test_what_is_under_the_mask_does_not_matter(controller, poison):
    for plain, poisoned in zip(
        run(controller, GRID), run(controller, GRID, poison=poison), strict=True
    ):
        np.testing.assert_array_equal(plain, poisoned)


def test_a_reported_nan_counts_as_missing(controller):
    controller.reset(context_for(GRID))
    for observation in observations(GRID):
        observation.values[0, 1] = np.nan
        controller.decide(observation)
        assert np.isfinite(controller.estimates()).all()


def test_the_same_seed_decides_the_same_after_reset_and_another_otherwise(controller):
    first, again, other = (run(controller, GRID, seed)[1] for seed in (4, 4, 5))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


@SCORINGS
def test_permuting_intersections_permutes_the_decisions(make, scoring):
    order = np.array([2, 5, 0, 1, 4, 3])
    plain, other = (make(scoring, 3) for _ in range(2))
    plain.reset(context_for(GRID))
    other.reset(context_for(reordered(GRID, order)))
    reorder_noise(other._planner, order)
    for observation in observations(GRID):
        phases = plain.decide(observation)
        assert other.decide(taken(observation, order)).tolist() == phases[order].tolist()
        np.testing.assert_allclose(other.estimates(), plain.estimates()[order], atol=1e-3)
        np.testing.assert_allclose(other.plans(), plain.plans()[order], atol=1e-3)


def test_estimates_and_plans_are_those_of_the_last_decision(controller):
    controller.reset(context_for(GRID))
    assert controller.estimates() is None
    assert controller.plans() is None
    for observation in observations(GRID):
        controller.decide(observation)
        seen = observation.mask
        np.testing.assert_array_equal(controller.estimates()[seen], observation.values[seen])
        assert controller.plans().shape == (GRID.n, 3, 12, 2)
    controller.reset(context_for(GRID))
    assert controller.estimates() is None


class TestSamples:
    """Several samples of an intersection of which nothing is known."""

    @pytest.fixture
    def make(self, weights, values):
        def made(samples):
            return DiffLight(weights, 3, "value", [values], samples)

        return made

    def run(self, controller, dark, poison=0.0):
        """What each decision was planned on, and the phases."""
        controller.reset(context_for(GRID))
        found = []
        for observation in observations(GRID):
            observation.mask[dark] = False
            observation.values[dark] = poison
            phases = controller.decide(observation)
            found.append((controller._planned, phases.tolist()))
        return found

    def test_only_what_is_not_seen_differs_between_them(self, make):
        for planned, _ in self.run(make(4), dark=[1, 4]):
            samples = planned.samples
            assert len(samples) == 4
            for other in samples[1:]:
                assert not np.array_equal(other[[1, 4]], samples[0][[1, 4]])
                np.testing.assert_array_equal(other[[0, 2, 3, 5]], samples[0][[0, 2, 3, 5]])

    def test_the_first_is_that_of_one_sample(self, make):
        several, one = (self.run(make(samples), dark=[1]) for samples in (4, 1))
        np.testing.assert_allclose(
            several[0][0].samples[0], one[0][0].samples[0], rtol=1e-3, atol=1e-3
        )
        assert len(one[0][0].samples) == 1

    def test_what_is_under_the_mask_does_not_matter(self, make):
        plain = self.run(make(3), dark=[0, 1])
        poisoned = self.run(make(3), dark=[0, 1], poison=1e9)
        assert [phases for _, phases in plain] == [phases for _, phases in poisoned]

    def test_several_networks_decide_together_only_where_nothing_is_known(self, weights, values):
        other = values.with_name("other.safetensors")
        torch.manual_seed(1)
        save_q_network(PhaseValue(8, 2, certainty=True), "value", 8, other, {})
        made = {
            paths: DiffLight(weights, 3, "value", paths, 4)
            for paths in ((values,), (other,), (values, other))
        }
        ways = [self.run(controller, dark=[1, 4]) for controller in made.values()]
        of = [[c._scores(p) for p, _ in way] for c, way in zip(made.values(), ways, strict=True)]
        for first, second, both in zip(*of, strict=True):
            seen = [0, 2, 3, 5]
            np.testing.assert_array_equal(both[seen], first[seen])
            mean = (first + second)[[1, 4]] / 2
            np.testing.assert_allclose(both[[1, 4]], mean, rtol=1e-5, atol=1e-5)
            assert not np.allclose(first[[1, 4]], second[[1, 4]])

    def test_nobody_is_sampled_again_where_everybody_is_seen(self, make):
        controller = make(4)
        controller.reset(context_for(GRID))
        for observation in observations(GRID):
            observation.mask[:, 4] = True
            observation.values[:, 4] = 1.0
            controller.decide(observation)
            assert len(controller._planned.samples) == 1


@pytest.mark.parametrize("dark", [[], [1, 4]])
def test_horizon_plans_on_a_model_that_the_generated_present_corrects(make, monkeypatch, dark):
    """What was observed is taken as it is; elsewhere the guess has a small part."""
    controller, given = make("horizon", 3), []
    plain = HorizonPlans.costs

    def watched(self, observation, guess=None):
        given.append(guess)
        return plain(self, observation, guess)

    monkeypatch.setattr(HorizonPlans, "costs", watched)
    controller.reset(context_for(GRID))
    for observation in observations(GRID):
        observation.mask[dark] = False
        observation.values[dark] = np.nan
        phases = controller.decide(observation)
        believed, seen = controller.estimates(), observation.mask
        np.testing.assert_array_equal(given[-1], np.maximum(controller._planned.present, 0))
        np.testing.assert_array_equal(believed[seen], observation.values[seen])
        assert np.isfinite(believed).all()
        assert GRID.phase_mask[np.arange(GRID.n), phases].all()
    assert len(given) == STEPS


def test_mixed_scores_by_queue_where_there_is_no_sensor(weights):
    context = context_for(GRID)
    context.sensors[1] = False
    runs = {}
    for scoring in ("inverse", "queue", "mixed"):
        controller = DiffLight(weights, 2, scoring)
        controller._planner._guided = True  # the present that "queue" sees is else not guided
        controller.reset(context)
        runs[scoring] = np.array([controller.decide(o) for o in observations(GRID)])
    blind = np.arange(GRID.n) == 1
    expected = np.where(blind, runs["queue"], runs["inverse"])
    np.testing.assert_array_equal(runs["mixed"], expected)
    assert not np.array_equal(runs["queue"], runs["inverse"])


@SCORINGS
def test_a_broken_model_is_answered_for_and_counted(tmp_path, make, scoring):
    safe = Safe(make(scoring, 2, save_broken(tmp_path / "broken")), deadline_s=60)
    phases, _ = run(safe, GRID)
    assert GRID.phase_mask[np.arange(GRID.n), phases].all()
    assert safe.fallback_steps == STEPS * GRID.n
    assert "no legal phase" in safe.last_error


def test_one_intersection_without_numbers_leaves_the_others_theirs():
    scores = np.array([[1.0, 2.0], [np.nan, 1.0], [3.0, -np.inf], [np.nan, -np.inf]])
    assert best_finite(scores).tolist() == [1, -1, 0, -1]


def test_the_memory_holds_the_last_steps_and_nothing_from_before_the_first():
    recent = RecentSteps(GRID.n, 5)
    seen = []
    for observation in observations(GRID):
        recent.take(observation)
        seen.append(observation)
        count = min(len(seen), 5)
        assert not recent.known[:, : 5 - count].any()
        assert np.isnan(recent.values[:, : 5 - count]).all()
        for age, past in enumerate(reversed(seen[-5:])):
            np.testing.assert_array_equal(recent.values[:, -1 - age], past.values)
            np.testing.assert_array_equal(recent.known[:, -1 - age], past.mask)
            np.testing.assert_array_equal(recent.red_steps[:, -1 - age], past.red_steps)
            np.testing.assert_array_equal(recent.green[:, -1 - age], past.red_steps == 0)


@pytest.mark.parametrize(
    ("options", "steps"),
    [
        ({}, (3, 8)),
        ({"diffusion": {"scoring": "queue"}}, (3, 8)),
        ({"diffusion": {"scoring": "inverse"}}, (10, 10)),
        ({"diffusion": {"scoring": "mixed"}}, (10, 10)),
        ({"diffusion": {"scoring": "mixed", "sampling_steps": 4}}, (4, 4)),
        ({"diffusion": {"sampling_steps": 10}}, (10, 10)),
        ({"controller": "max-queue", "imputer": "diffusion"}, (3, 8)),
        ({"controller": "difflight-paper"}, (10, 10)),
    ],
)
def test_few_reverse_steps_unless_rewards_guide_the_plan(options, steps, monkeypatch):
    made = []

    class Watched(Planner):
        def __init__(self, weights, sampling_steps, *further, **named):
            super().__init__(weights, sampling_steps, *further, **named)
            made.append((self._sampling_steps, self._blind_steps))

    monkeypatch.setattr(planner, "Planner", Watched)
    published = options.get("controller") == "difflight-paper"
    if published:
        monkeypatch.setattr(DiffLight, "is_published", True)
        options = {**options, "diffusion": {"weights": "strict-jinan_1-random"}}
    controller_of(RunSettings(**options))
    assert made == [steps]


def test_more_sampling_steps_than_the_model_has(weights):
    with pytest.raises(UserError, match=r"sampling_steps: 21 is not allowed; .* 1 to 20"):
        DiffLight(weights, sampling_steps=21)


def test_a_cut_off_file_is_refused_at_once(weights, tmp_path):
    short = tmp_path / "short"
    short.write_bytes(weights.read_bytes()[:-100])
    with pytest.raises(UserError, match="not a weights file, or cut off"):
        DiffLight(short)


def test_naming_the_controllers_does_not_import_torch():
    code = (
        "import sys, tsc_missing.controllers.registry, tsc_missing.controllers.difflight, "
        "tsc_missing.imputation.diffusion, tsc_missing.weights.find; "
        "sys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


class TestFindWeights:
    @pytest.fixture(autouse=True)
    def _two_come_with_the_package(self, tmp_path, monkeypatch):
        for name in ("universal", "strict"):
            (tmp_path / "package" / name).mkdir(parents=True)
            (tmp_path / "package" / name / find.FILE).touch()
        monkeypatch.setattr(find, "FOLDER", tmp_path / "package")

    def test_by_name(self, tmp_path):
        path = tmp_path / "package" / "universal" / find.FILE
        assert find.find_weights("universal") == path

    def test_by_path(self, tmp_path):
        (tmp_path / "mine").mkdir()
        path = tmp_path / "mine" / find.FILE
        path.touch()
        assert find.find_weights(str(path)) == path
        assert find.find_weights(str(path.parent)) == path

    @pytest.mark.parametrize("name", ["univers", "", "no/such/file", ".", "x" * 9999])
    def test_neither(self, name, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        with pytest.raises(UserError, match="allowed: strict, universal, or the path") as caught:
            find.find_weights(name)
        assert "`tsc-train universal` makes some" in str(caught.value)
        assert ("did you mean universal?" in str(caught.value)) == (name == "univers")

    def test_none_at_all(self, tmp_path, monkeypatch):
        monkeypatch.setattr(find, "FOLDER", tmp_path / "nothing")
        monkeypatch.chdir(tmp_path)
        with pytest.raises(UserError, match="none come with this installation"):
            find.find_weights("mine")
        with pytest.raises(UserError, match="`tsc-train universal` makes them"):
            find.find_weights("universal")
