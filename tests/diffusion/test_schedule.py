import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("torch", reason="the diffusion controller needs torch")

import torch

from tsc_missing.diffusion.ddim import sample
from tsc_missing.diffusion.schedule import CosineSchedule

SCHEDULE = CosineSchedule(100)


def test_numbers_are_those_of_the_formula():
    def f(k):
        return math.cos((k / 100 + 0.008) / 1.008 * math.pi / 2) ** 2

    assert SCHEDULE.alpha_bar[0] == 1
    for k in (1, 10, 50, 99):
        assert SCHEDULE.alpha_bar[k].item() == pytest.approx(f(k) / f(0), rel=1e-9)
    assert SCHEDULE.alpha_bar[50].item() == pytest.approx(0.4938441, abs=1e-6)
    assert SCHEDULE.beta[100].item() == 0.999
    assert (SCHEDULE.alpha_bar.diff() < 0).all()


def test_noise_and_x0_say_the_same():
    x0, noise = torch.randn(3, 8, 12, 2), torch.randn(3, 8, 12, 2)
    k = torch.tensor([1, 50, 95])
    x = SCHEDULE.q_sample(x0, k, noise)
    torch.testing.assert_close(SCHEDULE.x0_from_noise(x, k, noise), x0, rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(SCHEDULE.noise_from_x0(x, k, x0), noise, rtol=1e-4, atol=1e-4)


def test_sampling_steps():
    assert SCHEDULE.sampling_steps(10) == [100, 90, 80, 70, 60, 50, 40, 30, 20, 10, 0]
    assert SCHEDULE.sampling_steps(1) == [100, 0]
    assert SCHEDULE.sampling_steps(100) == list(range(100, -1, -1))
    assert SCHEDULE.sampling_steps(10, leading=True) == [91, 81, 71, 61, 51, 41, 31, 21, 11, 1, 0]
    for count in (0, 101):
        with pytest.raises(ValueError, match="must be 1 to 100"):
            SCHEDULE.sampling_steps(count)


@given(st.integers(1, 100))
def test_leading_steps_are_as_far_apart_and_end_at_one(count):
    ks = SCHEDULE.sampling_steps(count, leading=True)
    jumps = {k - smaller for k, smaller in itertools.pairwise(ks[:-1])}
    assert len(ks) == count + 1
    assert ks[-2:] == [1, 0]
    assert ks[0] <= 101 - 100 // count
    assert jumps <= {100 // count, 100 // count + 1}


def test_a_noise_that_is_a_little_off_spoils_little_from_leading_steps():
    """x̂^0 is kept to 0 … 8, as the model does; the data are 0.1 everywhere."""

    def denoise(x, k):
        noise = SCHEDULE.noise_from_x0(x, k, torch.full_like(x, 0.1))
        return SCHEDULE.x0_from_noise(x, k, 0.99 * noise).clamp(0, 8)

    first = torch.randn(1000, generator=torch.Generator().manual_seed(0))
    off = {}
    for leading in (False, True):
        ks = SCHEDULE.sampling_steps(10, leading=leading)
        made = sample(SCHEDULE, denoise, first, ks[:2], lambda x, _: x)
        noised = SCHEDULE.q_sample(torch.tensor([0.1]), torch.tensor([ks[1]]), first)
        off[leading] = (made - noised).abs().mean().item()
    assert off[False] > 0.5  # half of a noise that has a standard deviation of one
    assert off[True] < 0.05


def test_ddim_carries_noise_to_the_data():
    """For data N(0, s²) the best denoiser is linear, and the exact flow multiplies by s."""
    spread = 0.5

    def denoise(x, k):
        signal = SCHEDULE.alpha_bar[k].float()
        return signal.sqrt() * spread**2 * x / (signal * spread**2 + 1 - signal)

    noise = torch.randn(1000, generator=torch.Generator().manual_seed(0))
    ks = SCHEDULE.sampling_steps(100)
    made = sample(SCHEDULE, denoise, noise, ks, lambda x, _: x)
    torch.testing.assert_close(made, spread * noise, rtol=0.05, atol=0.01)


def test_the_hook_runs_after_every_step():
    seen = []

    def after_step(x, x0):
        seen.append((x.clone(), x0))
        return x + 1

    ks = SCHEDULE.sampling_steps(5)
    made = sample(SCHEDULE, lambda x, k: 0.5 * x, torch.ones(2), ks, after_step)
    assert len(seen) == 5
    torch.testing.assert_close(made, seen[-1][0] + 1)
    torch.testing.assert_close(seen[-1][0], seen[-1][1])  # the last step gives x̂^0 itself
