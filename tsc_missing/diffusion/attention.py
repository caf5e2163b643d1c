"""Attention over sequences of 8 to 24 keys, written for processors.

Library kernels lose most of their time in a softmax over such short rows. Here a row's sum comes
from a product with a matrix of ones, which leaves it in every column, so that everything beside
the two products runs over whole arrays. A row's largest logit is subtracted only in a batch that
has logits for which exp could leave its range.
"""

import torch
from torch import Tensor

MAX_LOGIT = 30.0  # up to here exp stays in range without subtracting a row's largest


class _Attend(torch.autograd.Function):
    """f_Att(Q, K, V) of the paper, for scaled queries and optionally a mask of keys."""

    @staticmethod
    def forward(
        ctx: torch.autograd.function.FunctionCtx,
        q: Tensor,
        k: Tensor,
        v: Tensor,
        mask: Tensor | None,
    ) -> Tensor:
        logits = torch.bmm(q, k.transpose(1, 2))
        low, high = logits.aminmax()
        if low < -MAX_LOGIT or high > MAX_LOGIT:  # rare, and slow
            allowed = logits if mask is None else logits.masked_fill(mask == 0, -torch.inf)
            logits -= allowed.amax(dim=-1, keepdim=True)
            logits.clamp_(max=0)
        p = logits.exp_()
        if mask is not None:
            p.mul_(mask)
        p.div_(_row_sums(p))
        ctx.save_for_backward(q, k, v, p)
        return torch.bmm(p, v)

    @staticmethod
    def backward(
        ctx: torch.autograd.function.FunctionCtx, grad: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, None]:
        q, k, v, p = ctx.saved_tensors  # type: ignore[attr-defined]
        grad_v = torch.bmm(p.transpose(1, 2), grad)
        grad_s = torch.bmm(grad, v.transpose(1, 2)).mul_(p)
        grad_s.addcmul_(p, _row_sums(grad_s), value=-1)
        return torch.bmm(grad_s, k), torch.bmm(grad_s.transpose(1, 2), q), grad_v, None


def _row_sums(x: Tensor) -> Tensor:
    """Every entry replaced by the sum over the last axis."""
    width = x.shape[-1]
    return (x.view(-1, width) @ x.new_ones(width, width)).view_as(x)


def attend(q: Tensor, k: Tensor, v: Tensor, mask: Tensor | None = None) -> Tensor:
    """softmax(q kᵀ) v over S sequences; q (S, Q, d), already divided by sqrt(d), k and v (S, K, d).

    ``mask`` (S, 1 or Q, K) is 1 for the keys that count, 0 for the others; at least one counts.
    """
    out: Tensor = _Attend.apply(q, k, v, mask)  # type: ignore[no-untyped-call]
    return out


def split_heads(x: Tensor, parts: int, heads: int) -> tuple[Tensor, ...]:
    """(S, Q, parts * heads * d) to ``parts`` tensors (heads * S, Q, d)."""
    s, q, _ = x.shape
    apart = x.view(s, q, parts, heads, -1).permute(2, 3, 0, 1, 4)
    return apart.reshape(parts, heads * s, q, -1).unbind(0)


def merge_heads(x: Tensor, heads: int) -> Tensor:
    """(heads * S, Q, d) to (S, Q, heads * d)."""
    return x.view(heads, -1, *x.shape[1:]).permute(1, 2, 0, 3).flatten(2)
