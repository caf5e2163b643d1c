import pytest

pytest.importorskip("torch", reason="the diffusion controller needs torch")

import torch

from tsc_missing.diffusion.attention import attend, merge_heads, split_heads
from tsc_missing.diffusion.memory import keep_freed_memory


def tensors(*shape):
    g = torch.Generator().manual_seed(0)
    return [torch.randn(shape, generator=g, dtype=torch.float64).requires_grad_() for _ in range(3)]


def reference(q, k, v, mask):
    return torch.softmax(q @ k.transpose(1, 2) + mask.log(), dim=-1) @ v


@pytest.mark.parametrize("size", [1, 30], ids=["small logits", "large logits"])
@pytest.mark.parametrize("masked", [False, True])
def test_is_softmax_attention(masked, size):
    q, k, v = ((size * x).detach().requires_grad_() for x in tensors(5, 4, 3))
    assert ((q @ k.transpose(1, 2)).abs().max() > 100) == (size > 1)
    mask = torch.ones(5, 1, 4, dtype=torch.float64)
    if masked:
        mask[::2, :, 1:3] = 0
    given = mask if masked else None
    torch.testing.assert_close(attend(q, k, v, given), reference(q, k, v, mask))
    assert torch.autograd.gradcheck(lambda *x: attend(*x, given), (q, k, v))


def test_large_logits_stay_finite():
    q, k, v = (100 * x.detach().float().requires_grad_() for x in tensors(5, 4, 3))
    out = attend(q, k, v)
    out.sum().backward()
    assert out.isfinite().all()


def test_heads_there_and_back():
    x = torch.randn(6, 8, 16)
    (apart,) = split_heads(x, 1, heads=4)
    assert apart.shape == (24, 8, 4)
    torch.testing.assert_close(merge_heads(apart, 4), x)


def test_memory_settings_are_taken_or_refused():
    assert keep_freed_memory() in (True, False)
