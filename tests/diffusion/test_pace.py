"""Rows that take fewer reverse steps than others."""

import torch

from tests.diffusion.cases import VARIANTS, history, model
from tsc_missing.diffusion.difflight import DiffLightModel
from tsc_missing.diffusion.pace import Pace

N = 5
STEPS = 6


def planned(steps, pace=None, variant="no dcm"):
    made = model(VARIANTS[variant])
    noise = made.initial_noise(N, torch.Generator().manual_seed(1))
    return made.plan(history(N), noise, steps, guided=False, pace=pace)


def test_the_rows_of_a_pace_are_planned_as_without_it():
    """Without DCM: with it they hear from the others, at every step of their own."""
    plain, paced = planned(STEPS), planned(STEPS, Pace(torch.tensor([1, 3]), 2))
    torch.testing.assert_close(paced.imputed[[1, 3]], plain.imputed[[1, 3]])
    assert not torch.allclose(paced.future[[0, 2, 4]], plain.future[[0, 2, 4]])


def test_the_others_are_planned_in_few_steps():
    few, paced = planned(2), planned(STEPS, Pace(torch.tensor([1, 3]), 2))
    torch.testing.assert_close(paced.future[[0, 2, 4]], few.future[[0, 2, 4]], rtol=1e-3, atol=1e-3)


def test_a_pace_of_all_steps_is_none():
    plain, paced = (
        planned(STEPS, variant="difflight"),
        planned(STEPS, Pace(torch.tensor([1]), 9), "difflight"),
    )
    assert torch.equal(paced.future, plain.future)


def test_few_rows_are_worked_on_between(monkeypatch):
    worked = []
    whole = DiffLightModel._x0

    def watched(self, x, k, inputs, guided):
        worked.append(len(x))
        return whole(self, x, k, inputs, guided)

    monkeypatch.setattr(DiffLightModel, "_x0", watched)
    planned(STEPS, Pace(torch.tensor([1, 3]), 2))
    assert worked == [N, 2, 2, N, 2, 2]
