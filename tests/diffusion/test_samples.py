import torch

from tests.diffusion.cases import VARIANTS, history, model
from tsc_missing.diffusion.samples import all_samples, unseen, with_copies

N = 5


def dark(*rows):
    """The history of a line of intersections of which nothing is known at some."""
    seen = history(N)
    seen.known[list(rows)] = False
    return seen


def planned(seen, noise):
    """Without DCM: with it the others hear of the first sample only."""
    return model(VARIANTS["no dcm"]).plan(seen, noise, 4, guided=False)


def noise(count, seed=1):
    drawn = torch.Generator().manual_seed(seed)
    return model().initial_noise(count, drawn)


def test_unseen_are_those_of_which_no_slot_that_is_there_is_known():
    seen = dark(1, 3)
    seen.known[3, 0, 4] = True
    assert unseen(seen).tolist() == [1]
    seen.slots[3, 4] = False
    assert unseen(seen).tolist() == [1, 3]


def test_a_copy_is_planned_as_the_intersection_would_be_with_its_noise():
    seen, rows = dark(1, 3), torch.tensor([1, 3])
    first, other = noise(N), noise(N, seed=2)
    both = torch.cat((first, other[rows]))
    found = all_samples(planned(with_copies(seen, rows, 1), both).imputed, rows, N)
    alone = first.clone()
    alone[rows] = other[rows]
    torch.testing.assert_close(found[0], planned(seen, first).imputed)
    torch.testing.assert_close(found[1, rows], planned(seen, alone).imputed[rows])
    torch.testing.assert_close(found[1, [0, 2, 4]], found[0, [0, 2, 4]])
    assert not torch.equal(found[0, 1], found[1, 1])


def test_adjacent_unseen_intersections_hear_of_the_same_sample():
    seen, rows = dark(1, 2), torch.tensor([1, 2])
    copies = with_copies(seen, rows, 2)
    assert len(copies.slots) == N + 4
    table = copies.neighbours[N:, 3:6] // 12  # each intersection is fed by the next
    assert (table == torch.tensor([N + 1, 3, N + 3, 3])[:, None, None]).all()
    assert (copies.neighbours[:N] == seen.neighbours).all()
    assert (copies.downstream[N + 3, 3:6] // 12 == N + 2).all()


def test_where_everything_is_seen_there_is_one_sample():
    seen = history(N)
    rows = unseen(seen)
    assert with_copies(seen, rows, 3) is seen
    assert all_samples(noise(N), rows, N).shape[0] == 1
