"""zk0's action expert in PyTorch at any dimensions: one sample in, the sum of its squared errors out.

The same function as `circuits/src/eval.rs` computes in fixed point. As a program it writes a seeded model and sample
as `model.onnx` and `input.json`, and prints the number of weights and the loss in float32.
"""

import argparse
import json
import math
from pathlib import Path

import torch
from torch import nn
from torch.nn.functional import linear

EPS = 1e-5
ROPE_BASE = 10_000.0
MIN_PERIOD, MAX_PERIOD = 0.004, 4.0
SEED = 1


class RmsNorm(nn.Module):
    def __init__(self, width):
        super().__init__()
        self.weight = nn.Parameter(torch.ones(width))

    def forward(self, x):
        return x * torch.rsqrt(x.square().mean(-1, keepdim=True) + EPS) * self.weight


class Layer(nn.Module):
    """Self-attention over prefix and action tokens, or cross-attention to the prefix alone; then SwiGLU."""

    def __init__(self, dims, index):
        super().__init__()
        width, mlp, head = dims["expert_width"], dims["expert_mlp"], dims["head_dim"]
        query, kv = dims["heads"] * head, dims["kv_heads"] * head
        self.head, self.kv_heads = head, dims["kv_heads"]
        self.joint = index % dims["self_attn_every"] == 0
        kv_input = width if self.joint else kv
        self.input_norm, self.mlp_norm = RmsNorm(width), RmsNorm(width)
        self.q = nn.Linear(width, query, bias=False)
        self.k = nn.Linear(kv_input, kv, bias=False)
        self.v = nn.Linear(kv_input, kv, bias=False)
        self.o = nn.Linear(query, width, bias=False)
        self.gate = nn.Linear(width, mlp, bias=False)
        self.up = nn.Linear(width, mlp, bias=False)
        self.down = nn.Linear(mlp, width, bias=False)
        prefix, chunk = dims["max_prefix"], dims["chunk"]
        start = prefix if self.joint else 0
        frequencies = ROPE_BASE ** (-torch.arange(head // 2) / (head // 2))
        angles = torch.arange(start, start + chunk)[:, None, None] * frequencies
        self.register_buffer("cosines", angles.cos())
        self.register_buffer("sines", angles.sin())
        if self.joint:
            self.register_buffer("causal", torch.ones(chunk, chunk).tril())

    def rotate(self, x, scale=1.0):
        """RoPE over halves of (chunk, heads, head), times a constant."""
        low, high = x[..., : self.head // 2], x[..., self.head // 2 :]
        cosines, sines = self.cosines * scale, self.sines * scale
        return torch.cat([low * cosines - high * sines, high * cosines + low * sines], -1)

    def attend(self, queries, keys, values):
        """Grouped-query attention of (chunk, heads, head) over (tokens, kv_heads, head)."""
        chunk = queries.shape[0]
        group = queries.shape[1] // self.kv_heads
        q = queries.reshape(chunk, self.kv_heads, group, self.head).permute(1, 2, 0, 3)
        scores = q.reshape(self.kv_heads, group * chunk, self.head) @ keys.permute(1, 2, 0)
        weights = (scores - scores.amax(-1, keepdim=True)).exp()
        if self.joint:
            # A mask by multiplication is the same softmax, and needs no huge negative score in fixed point.
            prefix, own = weights[..., :-chunk], weights[..., -chunk:]
            own = own.reshape(self.kv_heads, group, chunk, chunk) * self.causal
            weights = torch.cat([prefix, own.reshape(self.kv_heads, group * chunk, chunk)], -1)
        # Divided after mixing, as `eval.rs` does: fewer values to divide.
        mixed = (weights @ values.permute(1, 0, 2)) * weights.sum(-1, keepdim=True).reciprocal()
        mixed = mixed.reshape(self.kv_heads, group, chunk, self.head)
        return mixed.permute(2, 0, 1, 3).reshape(chunk, -1)

    def forward(self, x, keys, values):
        normed = self.input_norm(x)
        queries = self.rotate(self.q(normed).reshape(x.shape[0], -1, self.head), self.head**-0.5)
        own_keys = self.k(normed if self.joint else keys).reshape(-1, self.kv_heads, self.head)
        own_values = self.v(normed if self.joint else values).reshape(-1, self.kv_heads, self.head)
        if self.joint:
            cached = [t.reshape(-1, self.kv_heads, self.head) for t in (keys, values)]
            own_keys = torch.cat([cached[0], self.rotate(own_keys)])
            own_values = torch.cat([cached[1], own_values])
        x = x + self.o(self.attend(queries, own_keys, own_values))
        normed = self.mlp_norm(x)
        gate = self.gate(normed)
        return x + self.down(gate * gate.sigmoid() * self.up(normed))


class Expert(nn.Module):
    """Loss of one sample: squared error of the velocity over frames that are not padding and real action dimensions.

    The time embedding comes in from outside: it is a public function of the flow time, and sines of up to 1571 rad are
    out of reach of a fixed-point lookup.
    """

    def __init__(self, dims):
        super().__init__()
        width, action = dims["expert_width"], dims["max_action_dim"]
        self.action_dim = dims["action_dim"]
        self.action_in = nn.Linear(action, width)
        self.time_in = nn.Linear(2 * width, width)
        self.time_out = nn.Linear(width, width)
        self.layers = nn.ModuleList(Layer(dims, i) for i in range(dims["layers"]))
        self.norm = RmsNorm(width)
        self.action_out = nn.Linear(width, action)

    def forward(self, cache, actions, noise, time, time_embedding, not_pad):
        """(layers, 2, prefix, kv), (chunk, action), the same, (1, 1), (1, width), (chunk, 1)."""
        noisy = actions + time * (noise - actions)
        embedded = self.action_in(noisy)
        joined = torch.cat([embedded, time_embedding.expand(embedded.shape[0], -1)], -1)
        hidden = self.time_in(joined)
        x = self.time_out(hidden * hidden.sigmoid())
        for index, layer in enumerate(self.layers):
            x = layer(x, cache[index, 0], cache[index, 1])
        # Only the real action dimensions. A mean over them, times their number, is one division a frame.
        real = self.action_dim
        velocity = linear(self.norm(x), self.action_out.weight[:real], self.action_out.bias[:real])
        error = velocity - (noise - actions)[:, :real]
        return (error.square().mean(-1, keepdim=True) * not_pad).sum().reshape(1) * real


def initialise(expert, layers):
    """The scales of `smolvla/src/init.rs`: uniform, of about unit size after every layer. But no bias is 0 and no gain 1,
    as after training: the export would leave such parameters out."""
    for name, tensor in expert.named_parameters():
        if tensor.dim() == 1:
            centre = 0.0 if name.endswith("bias") else 1.0
            nn.init.uniform_(tensor, centre - 0.1, centre + 0.1)
        else:
            std = tensor.shape[1] ** -0.5
            if name.startswith("action_out"):
                std *= 0.1
            if name.endswith(("o.weight", "down.weight")):
                std /= math.sqrt(2 * layers)
            nn.init.uniform_(tensor, -std * math.sqrt(3), std * math.sqrt(3))


def time_embedding(time, width):
    """Sines, then cosines, of 2 pi time / period; in float64 because the angles are large."""
    half = width // 2
    steps = torch.arange(half, dtype=torch.float64) / max(half - 1, 1)
    angles = 2 * math.pi * time.double() / (MIN_PERIOD * (MAX_PERIOD / MIN_PERIOD) ** steps)
    return torch.cat([angles.sin(), angles.cos()], -1).float()


def random_sample(dims):
    """A sample with a full prefix and no padding: the most there is to compute."""
    chunk, action = dims["chunk"], dims["max_action_dim"]
    kv = dims["kv_heads"] * dims["head_dim"]
    actions = torch.rand(chunk, action) * 2 - 1
    actions[:, dims["action_dim"] :] = 0
    time = torch.rand(1, 1)
    return {
        "cache": torch.randn(dims["layers"], 2, dims["max_prefix"], kv),
        "actions": actions,
        "noise": torch.randn(chunk, action),
        "time": time,
        "time_embedding": time_embedding(time, dims["expert_width"]),
        "not_pad": torch.ones(chunk, 1),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dims", type=json.loads, help="zk0_circuits::spec::Dims as JSON")
    parser.add_argument("folder", type=Path)
    args = parser.parse_args()
    torch.manual_seed(SEED)
    expert = Expert(args.dims).eval()
    initialise(expert, args.dims["layers"])
    sample = random_sample(args.dims)
    inputs = tuple(sample.values())
    with torch.no_grad():
        loss = expert(*inputs).item()
        torch.onnx.export(
            expert,
            inputs,
            args.folder / "model.onnx",
            input_names=list(sample),
            output_names=["squared_error"],
            dynamo=False,
            opset_version=17,
        )
    flat = [tensor.flatten().tolist() for tensor in inputs]
    (args.folder / "input.json").write_text(json.dumps({"input_data": flat}))
    weights = sum(tensor.numel() for tensor in expert.parameters())
    print(json.dumps({"weights": weights, "float32": loss, "elements": args.dims["chunk"] * args.dims["action_dim"]}))


if __name__ == "__main__":
    main()
