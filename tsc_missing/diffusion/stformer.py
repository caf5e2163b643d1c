"""STFormer, the noise model (section "Structure of STFormer").

Tokens are ordered (B, L, T): cross-attention and temporal attention then read whole sequences,
and only the spatial one needs a transposed copy of its input.

What is equal to the appendix but cheaper: the output projections of SSA and TSA are part of the
first layer of the MLP that follows them; the last layer of the neighbours' embedding is part of
their projection to keys and values. What is simpler than there: the diffusion step is not added to
the neighbours, whose values it would shift all alike (keys it would not matter to).
"""

import torch
from torch import Tensor, nn
from torch.nn import functional as nnf

from tsc_missing.diffusion.attention import attend, merge_heads, split_heads
from tsc_missing.diffusion.batch import N_SIGNALS, Inputs, blank
from tsc_missing.diffusion.config import DiffLightConfig
from tsc_missing.diffusion.layers import Dense, Projection, StepEmbedding, mlp
from tsc_missing.diffusion.noise_model import COMPUTE, NoiseModel
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.sensing.observation import N_FEATURES


class Cross(nn.Module):
    """CCA, the communication cross-attention (Eq. CCA, CCA+x)."""

    def __init__(self, config: DiffLightConfig) -> None:
        """Queries of the slots, keys and values of their neighbours."""
        super().__init__()
        self.heads = config.heads
        self.query = Projection(config.width, config.heads, "q")
        self.neighbour = Projection(config.width, config.heads, "kv")
        self.out = Dense(config.width, config.width)

    def forward(self, e: Tensor, steps: Tensor, neighbours: Tensor) -> Tensor:
        """Gives e' = f_CCA(e_ctr, e_ntr) + e_ctr.

        ``e`` (B, L, T, D), ``steps`` (B or 1, 1, T, D), ``neighbours`` (B, G, 3 * T, D): the
        queries of the 12 / G slots of a group stand beside each other.
        """
        batch, groups, keys, width = neighbours.shape
        queries = self.query(e + steps).view(batch * groups, -1, width)
        (q,) = split_heads(queries, 1, self.heads)
        k, v = split_heads(self.neighbour(neighbours.view(-1, keys, width)), 2, self.heads)
        found = merge_heads(attend(q, k, v), self.heads)
        out: Tensor = e + self.out(found).view_as(e)
        return out


class EncoderLayer(nn.Module):
    """SSA and TSA beside each other, then an MLP (Eq. SSA-and-TSA, STE)."""

    def __init__(self, config: DiffLightConfig) -> None:
        """``cross`` is what comes before them, if anything."""
        super().__init__()
        self.heads = config.heads
        self.cross = Cross(config) if config.neighbours else None
        self.spatial = Projection(config.width, config.heads, "qkv")
        self.temporal = Projection(config.width, config.heads, "qkv")
        self.mlp = mlp(2 * config.width, config.hidden, config.width)

    def forward(self, e: Tensor, condition: Tensor, slots: Tensor | None) -> Tensor:
        """f_MLP(f_SSA(e) + f_TSA(e)) + e, where ``condition`` is added to the attentions' input.

        ``e`` (B, L, T, D), ``condition`` (B, 1, T, D); ``slots`` (heads * B * T, 1, L) masks keys.
        """
        batch, lanes, steps, width = e.shape
        x = e + condition
        over_time = split_heads(self.temporal(x.view(-1, steps, width)), 3, self.heads)
        in_time = merge_heads(attend(*over_time), self.heads).view_as(e)
        by_step = x.transpose(1, 2).reshape(-1, lanes, width)
        q, k, v = split_heads(self.spatial(by_step), 3, self.heads)
        in_space = merge_heads(attend(q, k, v, slots), self.heads)
        in_space = in_space.view(batch, steps, lanes, width).transpose(1, 2)
        out: Tensor = e + self.mlp(torch.cat((in_space, in_time), dim=-1))
        return out


class STFormer(NoiseModel):
    """Embeddings, encoder layers and an output MLP, for any number of windows."""

    def __init__(self, config: DiffLightConfig) -> None:
        """Every input has an embedding of its own."""
        super().__init__(config)
        width, channels = config.width, N_FEATURES + (not config.inverse_dynamics)
        self.heads = config.heads
        extra = config.known_flag + N_SIGNALS * config.own_signals
        self.own = mlp(self.cell_width, width, width)  # e_ctr
        upstream = Dense(N_FEATURES + extra + 1, width)  # e_ntr, its first layer
        self.upstream = upstream if config.neighbours else None
        self.diffusion_step = StepEmbedding(width)  # e_dt
        self.trajectory_step = StepEmbedding(width)  # e_tt
        self.reward = mlp(1, width, width)  # e_r
        self.slot = nn.Parameter(torch.zeros(N_SLOTS, 1, width)) if config.slot_identity else None
        self.layers = nn.ModuleList(EncoderLayer(config) for _ in range(config.layers))
        self.out = mlp(width, width, channels)

    def _predict(
        self, x: Tensor, k: Tensor, inputs: Inputs, reward: Tensor, masks: Tensor
    ) -> Tensor:
        """(R, B, T, L, F); rewards enter after the first CCA, which the R branches share."""
        count, batch, length = masks.shape
        dtype = COMPUTE[self.precision]
        tt = self.trajectory_step(torch.arange(length))  # (T, D)
        steps = (self.diffusion_step(k)[:, None] + tt).unsqueeze(1)  # (B or 1, 1, T, D)
        e_r = blank(self.reward(reward.unsqueeze(-1)), masks)  # (R, B, T, D)
        condition = (steps.squeeze(1) + e_r).flatten(0, 1).unsqueeze(1).to(dtype)
        steps = steps.to(dtype)
        e = self._embed(x, inputs).to(dtype)
        neighbours = self._embed_neighbours(inputs, tt, dtype)
        slots = self._slot_mask(inputs.slots, length, count, dtype)
        for number, layer in enumerate(self.layers):
            assert isinstance(layer, EncoderLayer)
            if layer.cross is not None and neighbours is not None:
                e = layer.cross(e, steps, neighbours)
            if number == 0 and count > 1:
                e = e.repeat(count, 1, 1, 1)
                if neighbours is not None and len(self.layers) > 1:
                    neighbours = neighbours.repeat(count, 1, 1, 1)
                    steps = steps.expand(batch, -1, -1, -1).repeat(count, 1, 1, 1)
            e = layer(e, condition, slots)
        out: Tensor = self.out(e).float()
        return out.view(count, batch, N_SLOTS, length, -1).transpose(2, 3)

    def _embed(self, x: Tensor, inputs: Inputs) -> Tensor:
        """e_ctr (B, L, T, D) of x^k (B, T, L, F) and what is known of the cells."""
        cells = self._cells(x, inputs)
        e: Tensor = self.own(cells.transpose(1, 2).to(COMPUTE[self.precision]))
        return e if self.slot is None else e + self.slot.to(e.dtype)

    def _embed_neighbours(self, inputs: Inputs, tt: Tensor, dtype: torch.dtype) -> Tensor | None:
        """e_ntr (B, G, 3 * T, D); a neighbour that is not there is a token of its own."""
        if self.upstream is None:
            return None
        near = inputs.neighbours
        given = near.given & near.exists.unsqueeze(-1)
        features = [blank(near.values, given)]
        if self.known_flag:
            features.append(given.unsqueeze(-1).float())
        if self.own_signals:
            features.append(blank(near.signals, near.exists.unsqueeze(-1)))
        features.append(near.exists[..., None, None].float().expand(*given.shape, 1))
        e: Tensor = self.upstream(torch.cat(features, dim=-1).to(dtype)) + tt.to(dtype)
        return nnf.relu(e).flatten(2, 3)

    def _slot_mask(
        self, slots: Tensor, steps: int, count: int, dtype: torch.dtype
    ) -> Tensor | None:
        """(heads * R * B * T, 1, L) for SSA, or None where every slot is there."""
        if bool(slots.all()):
            return None
        there = slots | ~slots.any(dim=1, keepdim=True)
        rows = there.repeat(count, 1).repeat_interleave(steps, dim=0)
        return rows.repeat(self.heads, 1).unsqueeze(1).to(dtype)
