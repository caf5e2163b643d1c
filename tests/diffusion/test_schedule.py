import math

import pytest

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
    for count in (0, 101):
        with pytest.raises(ValueError, match="must be 1 to 100"):
            SCHEDULE.sampling_steps(count)


def test_ddim_carries_noise_to_the_data():
    """For data N(0, s²) the best denoiser is linear, and the exact flow multiplies by s."""
    spread = 0.5

    def denoise(x, k):
        signal = SCHEDULE.alpha_bar[k].float()
        return signal.sqrt() * spread**2 * x / (signal * spread**2 + 1 - signal)

    noise = torch.randn(1000, generator=torch.Generator().manual_seed(0))
    made = sample(SCHEDULE, denoise, noise, 100, lambda x, _: x)
    torch.testing.assert_close(made, spread * noise, rtol=0.05, atol=0.01)


def test_the_hook_runs_after_every_step():
    seen = []

    def after_step(x, x0):
        seen.append((x.clone(), x0))
        return x + 1

    made = sample(SCHEDULE, lambda x, k: 0.5 * x, torch.ones(2), 5, after_step)
    assert len(seen) == 5
    torch.testing.assert_close(made, seen[-1][0] + 1)
    torch.testing.assert_close(seen[-1][0], seen[-1][1])  # the last step gives x̂^0 itself
