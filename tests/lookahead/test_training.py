import json

import numpy as np
import pytest

pytest.importorskip("torch", reason="Q-networks need torch")

import torch
from pydantic import ValidationError

from tsc_missing.errors import UserError
from tsc_missing.lookahead.config import LookaheadSettings
from tsc_missing.lookahead.episode import draw_run, read_played
from tsc_missing.lookahead.labelled import Labelled
from tsc_missing.lookahead.regression import Regression, centred
from tsc_missing.lookahead.training import LookaheadTraining
from tsc_missing.qlearning.networks import Graph, PhaseValue
from tsc_missing.qlearning.weights import load_q_network, save_q_network
from tsc_missing.training.diverged import DivergedError
from tsc_missing.weights.file import read_tensors

from tests.controllers.planning import save_broken, save_tiny  # isort: skip
from tests.networks import grid_network, tee_network  # isort: skip


def settings(small_net, tmp_path, **changes):
    base = tmp_path / "base.safetensors"
    if not base.exists():
        torch.manual_seed(0)
        save_q_network(PhaseValue(8), "value", 8, base, {})
    values = {
        "nets": (str(small_net),),
        "demand": "recorded",
        "base": str(base),
        "horizon": 150,
        "episodes": 3,
        "held_out": 1,
        "tried": 0.5,
        "depth": 2,
        "updates": 10,
        "batch": 24,
        "history": 2,
    }
    return LookaheadSettings(**{**values, **changes})


def with_holes(small_net, tmp_path, **changes):
    """Kriging and everything observed in turn, one more mask for each, tiny diffusion weights."""
    fill = tmp_path / "fill.safetensors"
    if not fill.exists():
        save_tiny(fill)
    holes = {"lost": ("kriging", "none"), "patterns": ("random",), "sampling_steps": 2}
    return settings(small_net, tmp_path, fill=str(fill), **{**holes, **changes})


def test_stopped_and_gone_on_with_is_as_unbroken(small_net, tmp_path):
    plan = settings(small_net, tmp_path)
    whole = LookaheadTraining(plan, tmp_path / "whole").run(1)
    seen = []
    first = LookaheadTraining(plan, tmp_path / "broken")
    assert first.run(1, lambda there, _: seen.append(there), lambda: len(seen) == 2) is None
    assert seen == [1, 2]
    second = LookaheadTraining(plan, tmp_path / "broken", resume=True)
    assert second.there == 2
    (one, about), (other, _) = load_q_network(whole), load_q_network(second.run(1))
    for name, weight in one.state_dict().items():
        assert torch.equal(weight, other.state_dict()[name]), name
    assert about["history"] == one.history == 2
    assert about["gained"].keys() == {"learned", "held_out"}
    assert about["gained"]["learned"].keys() == {"observed"}
    assert about["tried"] > 0
    start, _ = load_q_network(tmp_path / "base.safetensors")
    assert not torch.equal(one.state_dict()["score.0.weight"], start.state_dict()["score.0.weight"])


@pytest.mark.usefixtures("one_worker")
def test_the_episodes_of_a_training_serve_another_way_of_learning(small_net, tmp_path):
    LookaheadTraining(settings(small_net, tmp_path), tmp_path / "t").run(1)
    longer = settings(small_net, tmp_path, updates=20)
    told = []
    LookaheadTraining(longer, tmp_path / "t", resume=True).run(1, lambda *now: told.append(now))
    assert "playing" not in {what for _, what in told}
    with pytest.raises(UserError, match="was begun with 2"):
        LookaheadTraining(settings(small_net, tmp_path, depth=3), tmp_path / "t", resume=True)
    with pytest.raises(UserError, match="it is there already"):
        LookaheadTraining(longer, tmp_path / "t")


def test_with_missing_data_stopped_and_gone_on_with_is_as_unbroken(small_net, tmp_path):
    plan = with_holes(small_net, tmp_path)
    whole = LookaheadTraining(plan, tmp_path / "whole").run(1)
    seen = []
    first = LookaheadTraining(plan, tmp_path / "broken")
    stop = lambda: any("filling" in what for what in seen)  # noqa: E731
    assert first.run(1, lambda _, what: seen.append(what), stop) is None
    made = len(list((tmp_path / "broken" / "beliefs").iterdir()))
    assert 0 < made < 3
    second = LookaheadTraining(plan, tmp_path / "broken", resume=True)
    (one, about), (other, _) = load_q_network(whole), load_q_network(second.run(1))
    for name, weight in one.state_dict().items():
        assert torch.equal(weight, other.state_dict()[name]), name
    assert one.certainty
    assert about["gained"]["learned"].keys() == {"observed", "believed"}
    save_broken(tmp_path / "fill.safetensors")
    with pytest.raises(UserError, match=r"resume: .*broken .*fill has changed"):
        LookaheadTraining(plan, tmp_path / "broken", resume=True)


@pytest.mark.usefixtures("one_worker")
def test_values_that_know_of_missing_data_are_the_base_of_more(small_net, tmp_path):
    first = with_holes(small_net, tmp_path)
    whole = LookaheadTraining(first, tmp_path / "whole").run(1)
    with pytest.raises(UserError, match="knows of missing data"):
        LookaheadTraining(settings(small_net, tmp_path, base=str(whole)), tmp_path / "next")
    save_broken(tmp_path / "fill.safetensors")
    broken = with_holes(small_net, tmp_path, base=str(whole))
    with pytest.raises(DivergedError, match="weights are not finite"):
        LookaheadTraining(broken, tmp_path / "diverged").run(1)
    assert not (tmp_path / "diverged" / "weights.safetensors").exists()
    save_tiny(tmp_path / "fill.safetensors")
    again = with_holes(small_net, tmp_path, base=str(whole))
    assert LookaheadTraining(again, tmp_path / "next").run(1).is_file()


@pytest.mark.parametrize(
    ("about", "words"),
    [
        ({"reward": "departures"}, "base: .* reward is departures"),
        ({"reward_scale": 20.0}, "reward_scale: 40.0 .* trained with 20.0"),
        ({"running_weight": 0.0}, "running_weight: 1.0 .* trained with 0.0"),
    ],
    ids=str,
)
def test_the_base_has_values_of_the_same_rewards(small_net, tmp_path, about, words):
    save_q_network(PhaseValue(8), "value", 8, tmp_path / "b.safetensors", {"training": about})
    plan = settings(small_net, tmp_path, base=str(tmp_path / "b.safetensors"))
    with pytest.raises(UserError, match=words):
        LookaheadTraining(plan, tmp_path / "t")


def test_values_look_back_no_further_than_holes_are_filled(small_net, tmp_path):
    plan = with_holes(small_net, tmp_path, history=8)
    with pytest.raises(UserError, match=r"history: 8 .* fills \d steps"):
        LookaheadTraining(plan, tmp_path / "t")


@pytest.mark.usefixtures("one_worker")
def test_an_episode_in_which_nothing_was_tried_costs_nothing(small_net, tmp_path):
    plan = with_holes(small_net, tmp_path, tried=1e-6)
    with pytest.raises(UserError, match="no phase was ever tried"):
        LookaheadTraining(plan, tmp_path / "t").run(1)


@pytest.mark.usefixtures("one_worker")
def test_a_training_begun_before_its_newest_settings_goes_on(small_net, tmp_path):
    folder = tmp_path / "t"
    LookaheadTraining(settings(small_net, tmp_path), folder).run(1)
    path = folder / "settings.json"
    old = json.loads(path.read_text())
    for name in ("lost", "patterns", "also", "fill"):
        del old[name]
    path.write_text(json.dumps(old))
    assert LookaheadTraining(settings(small_net, tmp_path), folder, resume=True).run(1).is_file()
    other = settings(small_net, tmp_path, also=(folder,))
    with pytest.raises(UserError, match=r"also: .* was begun with"):
        LookaheadTraining(other, folder, resume=True)
    path.write_text('{"algorithm": "other"}')
    with pytest.raises(UserError, match=r"resume: .*not those of lookahead"):
        LookaheadTraining(settings(small_net, tmp_path), folder, resume=True)


@pytest.mark.usefixtures("one_worker")
def test_episodes_of_another_training_are_learned_from_too(small_net, tmp_path):
    first = tmp_path / "first"
    LookaheadTraining(settings(small_net, tmp_path), first).run(1)
    plan = settings(small_net, tmp_path, seed=1)
    alone, _ = load_q_network(LookaheadTraining(plan, tmp_path / "alone").run(1))
    both = with_holes(small_net, tmp_path, seed=1, also=(first,))
    path = LookaheadTraining(both, tmp_path / "both").run(1)
    network, about = load_q_network(path)
    assert len(list((tmp_path / "both" / "beliefs").iterdir())) == 6
    assert about["also"][0]["seed"] == 0
    assert not torch.equal(alone.state_dict()["score.0.weight"], network.score[0].weight)
    for changes, words in (
        ({"also": (tmp_path / "nothing",)}, "also: .*nothing"),
        ({"also": (first,), "depth": 3}, "its depth must be 3, found 2"),
    ):
        with pytest.raises(UserError, match=words):
            LookaheadTraining(settings(small_net, tmp_path, **changes), tmp_path / "t")
    (first / "episodes" / "00001.safetensors").unlink()
    with pytest.raises(UserError, match="1 of its episodes are not there"):
        LookaheadTraining(both, tmp_path / "t")


def test_regression_finds_what_can_be_found():
    """Returns that depend on a queue two steps ago, which the base does not see."""
    network = tee_network()
    torch.manual_seed(0)
    plan = LookaheadSettings(
        nets=("x",), history=2, updates=400, batch=64, learning_rate=3e-3, weight_decay=0
    )
    base = PhaseValue(8)
    from tsc_missing.qlearning.features import names_with

    x = torch.rand(200, network.n, 12, len(names_with(2)))
    x[..., 0] = torch.from_numpy(network.slot_mask).float()
    queue = x[..., names_with(2).index("queue_2_ago")] * x[..., 0]
    returns = (torch.from_numpy(network.phases).float() @ queue.unsqueeze(-1)).squeeze(-1)
    returns = returns.masked_fill(~torch.from_numpy(network.phase_mask), torch.nan)
    counted = torch.ones(x.shape[:2], dtype=torch.bool)
    episodes = [
        Labelled("x", (x[rows],), (counted[rows],), returns[rows])
        for rows in (slice(150), slice(150, None))
    ]
    regression = Regression(plan, base, {"x": Graph.of(network)}, episodes[:1])
    assert regression.gained(episodes[1:])["observed"] == pytest.approx(0, abs=1e-6)
    for _ in range(plan.updates):
        regression.update()
    assert regression.gained(episodes[1:])["observed"] > 0.7
    assert regression.gained([]) == {}


def test_centred_leaves_absent_phases_out():
    found = centred(torch.tensor([[1.0, 3.0, torch.nan]]))
    assert found.tolist() == [[-1.0, 1.0, 0.0]]


@pytest.mark.usefixtures("one_worker")
def test_what_can_be_wrong(small_net, tmp_path):
    for wrong in ({"volume_min": 2}, {"epsilon_min": 0.5}, {"held_out": 3}, {"history": 9}):
        with pytest.raises(ValidationError):
            settings(small_net, tmp_path, **wrong)
    for base, words in (("attendlight", "of the algorithm value"), ("valu", "did you mean value")):
        with pytest.raises(UserError, match=words):
            LookaheadTraining(settings(small_net, tmp_path, base=base), tmp_path / "t")
    save_q_network(PhaseValue(8, 3), "value", 8, tmp_path / "far.safetensors", {})
    plan = settings(small_net, tmp_path, base=str(tmp_path / "far.safetensors"))
    with pytest.raises(UserError, match="the base looks back 3"):
        LookaheadTraining(plan, tmp_path / "t")


@pytest.mark.usefixtures("one_worker")
def test_episodes_that_teach_nothing(small_net, tmp_path):
    plan = settings(small_net, tmp_path, tried=1e-9)
    with pytest.raises(UserError, match="no phase was ever tried"):
        LookaheadTraining(plan, tmp_path / "t").run(1)


@pytest.mark.usefixtures("one_worker")
def test_an_episode_of_another_network(small_net, tmp_path):
    LookaheadTraining(settings(small_net, tmp_path), tmp_path / "t").run(1)
    path = tmp_path / "t" / "episodes" / "00000.safetensors"
    with pytest.raises(UserError, match="not the network of the episode"):
        read_played(path, grid_network(2, 2))


def test_runs_are_drawn(small_net, tmp_path):
    plan = settings(small_net, tmp_path, volume_min=0.5, volume_max=1.5)
    drawn = [draw_run(plan, number, scaled=True) for number in range(20)]
    assert len({run.seed for run, _ in drawn}) == 20
    assert all(0.5 <= run.volume <= 1.5 and 0.02 <= epsilon <= 0.15 for run, epsilon in drawn)
    assert np.std([run.volume for run, _ in drawn]) > 0.1
    assert draw_run(plan, 3, scaled=False)[0].volume == 1


@pytest.mark.usefixtures("one_worker")
def test_a_file_of_an_episode(small_net, tmp_path):
    LookaheadTraining(settings(small_net, tmp_path, tried=1.0), tmp_path / "t").run(1)
    about, tensors = read_tensors(
        tmp_path / "t" / "episodes" / "00000.safetensors", "lookahead-episode"
    )
    assert about["net"] == str(small_net)
    assert tensors["steps"].tolist() == list(range(10))
    assert tensors["returns"].shape[:2] == (10, 6)
