from dataclasses import replace

import pytest

pytest.importorskip("torch", reason="the diffusion controller needs torch")

import torch

from tests.diffusion.cases import PUBLISHED, TINY, VARIANTS, model, windows
from tsc_missing.diffusion.config import DiffLightConfig
from tsc_missing.diffusion.ema import Ema
from tsc_missing.diffusion.windows import training_batch


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


@pytest.mark.parametrize("config", VARIANTS.values(), ids=VARIANTS)
def test_every_weight_learns(config):
    made = model(config).train()
    made.loss(training_batch(windows(), config), generator()).total.backward()
    for name, weight in made.named_parameters():
        assert weight.grad is not None, name
        assert weight.grad.isfinite().all(), name
        shifts_all_logits = name == "inverse.score.2.bias"  # and so does nothing
        assert shifts_all_logits or weight.grad.abs().sum() > 0, name


@pytest.mark.parametrize("config", VARIANTS.values(), ids=VARIANTS)
def test_what_is_not_recorded_does_not_matter(config):
    made, plain = model(config), windows()
    poisoned = replace(
        plain,
        values=torch.where(plain.recorded.unsqueeze(-1), plain.values, 1e9),
        near_values=torch.where(plain.near_given.unsqueeze(-1), plain.near_values, -1e9),
    )
    a, b = (made.loss(training_batch(w, config), generator()) for w in (plain, poisoned))
    assert a.total.isfinite()
    torch.testing.assert_close(a.total, b.total)


def test_the_hidden_is_a_target_and_no_input():
    plain = windows(recorded=1.0)
    batch = training_batch(plain, TINY)
    past = torch.arange(8) < 5
    hidden = plain.hidden & past[:, None]
    assert not (batch.inputs.known & batch.target).any()
    assert torch.equal(batch.target[:, :5], hidden[:, :5])
    assert batch.target[:, 5:].all()
    assert not batch.inputs.known[:, 5:].any()
    assert torch.equal(batch.inputs.reward_known, ~hidden.any(dim=2))
    assert (batch.inputs.signals[:, 5:] == 0).all()
    assert batch.action_known.all()


def test_actions_count_only_between_recorded_observations():
    plain = windows()
    batch = training_batch(plain, TINY)
    assert torch.equal(batch.action_known, plain.recorded[:, 4:6].all(dim=2).all(dim=1))


def test_same_generator_same_loss():
    made, batch = model(), training_batch(windows(), TINY)
    first, again, other = (made.loss(batch, generator(s)).total for s in (0, 0, 1))
    assert first == again
    assert first != other


def test_learns_to_fill_and_to_tell_the_phase():
    made = model().train()
    batch = training_batch(windows(64, recorded=1.0), TINY)
    optimiser = torch.optim.Adam(made.parameters(), lr=1e-2)
    draw = generator()
    losses = []
    for _ in range(80):
        optimiser.zero_grad()
        losses.append(made.loss(batch, draw))
        losses[-1].total.backward()
        optimiser.step()
    assert losses[-1].diffusion < 0.3 * losses[0].diffusion
    assert losses[-1].inverse_accuracy > 0.9


@pytest.mark.parametrize("partial", [True, False])
def test_with_a_partial_loss_what_is_hidden_is_learned_without_rewards(partial):
    config = PUBLISHED.model_copy(update={"partial_loss": partial, "reward_dropout": 0.0})
    made, batch = model(config), training_batch(windows(recorded=1.0), config)
    past = (torch.arange(8) < 5)[:, None]
    other = replace(batch.inputs, reward=1 - batch.inputs.reward)

    def loss(inputs, target):
        wanted = replace(batch, inputs=inputs, target=target)
        return made.loss(wanted, generator()).diffusion.item()

    hidden, planned = batch.target & past, batch.target & ~past
    assert hidden.any()
    assert (loss(batch.inputs, hidden) == loss(other, hidden)) == partial
    assert loss(batch.inputs, planned) != loss(other, planned)


def test_a_partial_loss_of_padded_rewards_is_refused():
    with pytest.raises(ValueError, match="padded_rewards must be false"):
        DiffLightConfig(partial_loss=True, padded_rewards=True)


def test_ema_follows_and_resumes():
    made = model()
    ema = Ema(made, decay=0.5)
    with torch.no_grad():
        for weight in made.parameters():
            weight.add_(1.0)
    ema.update(made)
    expected = 1 - 2 / 11  # d = (1 + 1) / (10 + 1)
    for average, weight in zip(ema.model.parameters(), made.parameters(), strict=True):
        torch.testing.assert_close(weight - average, torch.full_like(weight, 1 - expected))
    other = Ema(model(seed=1), decay=0.5)
    other.load_state_dict(ema.state_dict())
    ema.update(made)
    other.update(made)
    for a, b in zip(ema.model.parameters(), other.model.parameters(), strict=True):
        assert torch.equal(a, b)


@pytest.mark.parametrize("wrong", [{"width": 31}, {"noise_model": "unet", "horizon": 4}, {"x": 1}])
def test_a_config_that_does_not_fit_is_refused(wrong):
    with pytest.raises(ValueError, match=r"multiple|Extra"):
        DiffLightConfig.model_validate(wrong)
