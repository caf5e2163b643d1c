from dataclasses import replace

import pytest

pytest.importorskip("torch", reason="the diffusion controller needs torch")

import torch

from tests.diffusion.cases import VARIANTS, history, line, model, plan, three_way
from tsc_missing.diffusion.batch import group_table
from tsc_missing.diffusion.history import inputs_at_inference
from tsc_missing.diffusion.prcd import combine


def assert_same(a, b):
    for name in ("imputed", "future", "logits"):
        torch.testing.assert_close(getattr(a, name), getattr(b, name), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("config", VARIANTS.values(), ids=VARIANTS)
def test_known_cells_are_kept_and_all_is_filled(config):
    present = history()
    made = plan(model(config), present)
    assert made.imputed.shape == (3, 5, 12, 2)
    assert made.future.shape == (3, 3, 12, 2)
    assert made.imputed.isfinite().all()
    assert made.future.isfinite().all()
    assert made.logits.isfinite().all()
    torch.testing.assert_close(made.imputed[present.known], present.values[present.known])


@pytest.mark.parametrize("config", VARIANTS.values(), ids=VARIANTS)
def test_what_is_under_the_mask_does_not_matter(config):
    present, made = history(), model(config)
    for poison in (1e9, -torch.inf):
        values = torch.where(present.known.unsqueeze(-1), present.values, poison)
        assert_same(plan(made, present), plan(made, replace(present, values=values)))


@pytest.mark.parametrize("config", VARIANTS.values(), ids=VARIANTS)
def test_permuting_intersections_permutes_the_decisions(config):
    present, made = history(4), model(config)
    noise = made.initial_noise(4, torch.Generator().manual_seed(1))
    order = torch.tensor([2, 0, 3, 1])
    place = order.argsort()

    def move(table):
        table = table[order]
        return torch.where(table >= 0, 12 * place[table.clamp(min=0) // 12] + table % 12, -1)

    permuted = replace(
        present,
        **{
            name: getattr(present, name)[order]
            for name in ("values", "known", "green", "red_steps", "observable", "slots", "phases")
        },
        neighbours=move(present.neighbours),
        downstream=move(present.downstream),
    )
    plain, other = plan(made, present, noise=noise), plan(made, permuted, noise=noise[order])
    torch.testing.assert_close(other.logits, plain.logits[order], rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(other.imputed, plain.imputed[order], rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("config", VARIANTS.values(), ids=VARIANTS)
def test_absent_slots_do_not_matter(config):
    present, made = three_way(history()), model(config)
    noise = made.initial_noise(3, torch.Generator().manual_seed(1))
    absent = ~present.slots.unsqueeze(1)
    changed = replace(
        present,
        values=torch.where(absent.unsqueeze(-1), 7.0, present.values),
        green=present.green ^ absent,
        red_steps=torch.where(absent, 3, present.red_steps),
    )
    noisy = torch.where(absent.unsqueeze(-1), 9.0, noise)
    a, b = plan(made, present, noise=noise), plan(made, changed, noise=noisy)
    torch.testing.assert_close(a.logits, b.logits, rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(a.future, b.future, rtol=1e-4, atol=1e-4)
    assert (a.imputed[:, :, :3] == 0).all()


def test_another_phase_table_needs_no_other_weights():
    present, made = history(), model()
    single = torch.eye(12, dtype=torch.bool).expand(3, -1, -1)
    mask = torch.arange(12).expand(3, -1) < torch.tensor([[12], [12], [5]])
    each = plan(made, replace(present, phases=single, phase_mask=mask)).logits
    assert (each[2, 5:] == -torch.inf).all()
    grouped = plan(made, present).logits
    torch.testing.assert_close(grouped[:2, 0], (each[:2, 4] + each[:2, 10]) / 2)


def test_bfloat16_is_close():
    present = history()
    exact = plan(model(), present)
    rough = plan(model().use("bfloat16"), present)
    assert (exact.future - rough.future).abs().mean() < 0.5  # [vehicles]


def step_inputs(made, present):
    table = group_table(present.neighbours, present.slots)
    inputs, _ = inputs_at_inference(present, table, made.config, made.scaling)
    return inputs, made.initial_noise(len(present.slots), torch.Generator().manual_seed(1))


@pytest.mark.parametrize("name", ["difflight", "published", "two layers"])
def test_a_cell_without_a_reward_is_unchanged_by_any_reward(name):
    made, present = model(VARIANTS[name]), history()
    observable = present.observable.clone()
    observable[1] = False
    observable[2, ::2] = False
    inputs, x = step_inputs(made, replace(present, observable=observable))
    other = replace(
        inputs,
        reward=torch.rand(inputs.reward.shape),
        reward_known=torch.rand(inputs.reward.shape) < 0.5,
    )
    k = torch.tensor([10])
    with torch.no_grad():
        a, b = (
            combine(*made.noise_model.branches(x, k, each), inputs.observable, 1.2)
            for each in (inputs, other)
        )
    torch.testing.assert_close(a[~inputs.observable], b[~inputs.observable], rtol=0, atol=0)
    assert (a[inputs.observable] != b[inputs.observable]).any(dim=-1).all()


def test_prcd_numbers():
    with_reward, without = torch.full((1, 1, 2, 2), 3.0), torch.full((1, 1, 2, 2), 1.0)
    observable = torch.tensor([[[True, False]]])
    made = combine(with_reward, without, observable, guidance=1.5)
    torch.testing.assert_close(made, torch.tensor([[[[4.0, 4.0], [1.0, 1.0]]]]))


def test_a_missing_reward_is_not_a_reward_of_zero():
    made, present = model(), history(observed=0.0)
    inputs, x = step_inputs(made, present)
    past = torch.arange(8) < 5
    zeros = replace(
        inputs,
        reward=torch.where(past, 0.0, inputs.reward),
        reward_known=torch.ones_like(inputs.reward_known),
    )
    k = torch.tensor([10])
    with torch.no_grad():
        masked, padded = (made.noise_model.branches(x, k, each)[0] for each in (inputs, zeros))
        same = model(VARIANTS["padded"]).noise_model
        torch.testing.assert_close(same.branches(x, k, inputs), same.branches(x, k, zeros))
    assert not torch.allclose(masked, padded)


@pytest.mark.parametrize("dcm", [True, False])
@pytest.mark.parametrize("steps", [1, 2, 3])
def test_dcm_carries_one_hop_a_reverse_step(dcm, steps):
    """On a line, intersection 2 feeds 1 and 1 feeds 0: it is two hops away from 0."""
    made = model(VARIANTS["difflight"].model_copy(update={"dcm": dcm}))
    present = history(observed=0.5)
    present = replace(present, red_steps=torch.zeros_like(present.red_steps))
    changed = replace(present, values=present.values.clone())
    changed.values[2] *= 0.2
    a, b = plan(made, present, steps), plan(made, changed, steps)
    moved = (a.future != b.future).flatten(1).any(dim=1)
    assert moved.tolist() == [dcm and steps >= 2, True, True]


def test_neighbours_are_grouped_by_approach_only_where_they_agree():
    table, slots = line(3), torch.ones(3, 12, dtype=torch.bool)
    grouped = group_table(table, slots)
    assert grouped.shape == (3, 4, 3)
    torch.testing.assert_close(grouped.repeat_interleave(3, dim=1), table)
    table[0, 4, 0] = -1
    assert group_table(table, slots).shape == (3, 12, 3)
    slots[0, 4] = False
    assert group_table(table, slots).shape == (3, 4, 3)


def test_grouping_does_not_change_the_answer():
    present, made = history(), model()
    slots = present.slots.clone()
    slots[:, 2] = False
    present = replace(present, slots=slots, known=present.known & slots.unsqueeze(1))
    table = present.neighbours.clone()
    table[:, 2, 0] = 0
    assert group_table(table, torch.ones_like(slots)).shape[1] == 12
    assert group_table(table, slots).shape[1] == 4
    grouped = plan(made, replace(present, neighbours=table))
    torch.testing.assert_close(grouped.logits, plan(made, present).logits)


GOLDEN = {
    "no downstream": [
        [0.193226, 0.049189, 0.069742, 0.170731],
        [1.915288, 3.707976, 1.182490, 0.0],
        [8.720558, 6.853758, 8.026296, 6.252992],
    ],
    "difflight": [
        [0.193931, 0.049306, 0.071204, 0.171731],
        [1.484829, 3.516485, 0.802430, 0.0],
        [8.300694, 6.630116, 7.579892, 6.122064],
    ],
}


@pytest.mark.parametrize("variant", GOLDEN)
def test_golden_full_loop(variant):
    """Ten steps with guidance, DCM and holes on weights that come from formulas."""
    made, present = model(VARIANTS[variant]), history(2, observed=0.5, seed=5)
    with torch.no_grad():
        for number, weight in enumerate(made.parameters()):
            index = torch.arange(weight.numel(), dtype=torch.float64).view(weight.shape)
            weight.copy_(0.3 * torch.sin(0.7 * index + number))
    cells = torch.arange(2 * 8 * 12 * 2, dtype=torch.float64).view(2, 8, 12, 2)
    noise = torch.sin(1.3 * cells).float()
    values = 10 + 8 * torch.cos(0.9 * cells[:, :5])
    known = (cells[:, :5, :, 0] * 7 % 5) < 3
    green = (cells[:, :5, :, 0] * 3 % 4) == 0
    present = replace(
        present, values=values, known=known, green=green, red_steps=(~green).int() * 2
    )
    out = plan(made, present, steps=10, noise=noise)
    rows = [out.logits[0], out.future[1, 0, :4, 0], out.imputed[~known][:4, 1]]
    wanted = torch.tensor(GOLDEN[variant])
    torch.testing.assert_close(torch.stack(rows), wanted, rtol=1e-3, atol=1e-3)
