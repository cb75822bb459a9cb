"""SmolVLA's training step in PyTorch alone, for machines that have PyTorch and no LeRobot.

usage: torch_step.py tiny|full BATCH STEPS [cpu|cuda]    times steps with random weights, and prints one JSON line
       torch_step.py check FIXTURE                       prints how far its loss and gradients are from LeRobot's on the tiny policy

On a GPU the pass runs under autocast to bf16, and TF32 is allowed, as LeRobot's own training script does. A step is forward (resizing the
pictures included), backward, clipping and AdamW; the first is not counted. lerobot_side.py times LeRobot's own step.
"""

import json
import math
import statistics
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import torch
import torch.nn.functional as F

VISION = "model.vlm_with_expert.vlm.model.vision_model."
CONNECTOR = "model.vlm_with_expert.vlm.model.connector.modality_projection.proj"
TEXT = "model.vlm_with_expert.vlm.model.text_model."
EXPERT = "model.vlm_with_expert.lm_expert."

TINY = SimpleNamespace(
    image=64, patch=16, vision=48, vision_mlp=96, vision_layers=2, vision_heads=3, shuffle=2,
    text=72, text_mlp=160, layers=4, heads=6, kv_heads=2, head=12, vocabulary=128, expert=54, expert_mlp=256, chunk=10, padded=32,
)  # fmt: skip
FULL = SimpleNamespace(
    image=512, patch=16, vision=768, vision_mlp=3072, vision_layers=12, vision_heads=12, shuffle=4,
    text=960, text_mlp=2560, layers=16, heads=15, kv_heads=5, head=64, vocabulary=49280, expert=720, expert_mlp=2048, chunk=50, padded=32,
)  # fmt: skip


def shapes(d):
    """The shape of each parameter that a step uses, by LeRobot's names."""
    of = {}

    def linear(name, out, into, bias=True):
        of[name + ".weight"] = (out, into)
        if bias:
            of[name + ".bias"] = (out,)

    def norm(name, width, bias=True):
        of[name + ".weight"] = (width,)
        if bias:
            of[name + ".bias"] = (width,)

    of[VISION + "embeddings.patch_embedding.weight"] = (d.vision, 3, d.patch, d.patch)
    of[VISION + "embeddings.patch_embedding.bias"] = (d.vision,)
    of[VISION + "embeddings.position_embedding.weight"] = ((d.image // d.patch) ** 2, d.vision)
    for i in range(d.vision_layers):
        layer = f"{VISION}encoder.layers.{i}."
        for name in ("q_proj", "k_proj", "v_proj", "out_proj"):
            linear(layer + "self_attn." + name, d.vision, d.vision)
        linear(layer + "mlp.fc1", d.vision_mlp, d.vision)
        linear(layer + "mlp.fc2", d.vision, d.vision_mlp)
        norm(layer + "layer_norm1", d.vision)
        norm(layer + "layer_norm2", d.vision)
    norm(VISION + "post_layernorm", d.vision)
    linear(CONNECTOR, d.text, d.vision * d.shuffle**2, bias=False)
    of[TEXT + "embed_tokens.weight"] = (d.vocabulary, d.text)
    for part, width, mlp in ((TEXT, d.text, d.text_mlp), (EXPERT, d.expert, d.expert_mlp)):
        for i in range(d.layers):
            layer = f"{part}layers.{i}."
            keys_from = d.kv_heads * d.head if part == EXPERT and i % 2 else width
            linear(layer + "self_attn.q_proj", d.heads * d.head, width, bias=False)
            linear(layer + "self_attn.k_proj", d.kv_heads * d.head, keys_from, bias=False)
            linear(layer + "self_attn.v_proj", d.kv_heads * d.head, keys_from, bias=False)
            linear(layer + "self_attn.o_proj", width, d.heads * d.head, bias=False)
            linear(layer + "mlp.gate_proj", mlp, width, bias=False)
            linear(layer + "mlp.up_proj", mlp, width, bias=False)
            linear(layer + "mlp.down_proj", width, mlp, bias=False)
            norm(layer + "input_layernorm", width, bias=False)
            norm(layer + "post_attention_layernorm", width, bias=False)
    norm(EXPERT + "norm", d.expert, bias=False)
    linear("model.state_proj", d.text, d.padded)
    linear("model.action_in_proj", d.expert, d.padded)
    linear("model.action_out_proj", d.padded, d.expert)
    linear("model.action_time_mlp_in", d.expert, 2 * d.expert)
    linear("model.action_time_mlp_out", d.expert, d.expert)
    return of


def is_trained(name):
    return not name.startswith((VISION, CONNECTOR, TEXT))


def random_weights(d, device):
    weights = {}
    for name, shape in shapes(d).items():
        if len(shape) == 1:
            weights[name] = torch.full(shape, float("norm" in name and not name.endswith("bias")), device=device)
        else:
            weights[name] = torch.randn(shape, device=device) / math.prod(shape[1:]) ** 0.5
    return weights


class Step:
    def __init__(self, d, weights):
        self.d, self.weights = d, weights
        self.trained = {name: weights[name].requires_grad_() for name in weights if is_trained(name)}

    def linear(self, name, x):
        return F.linear(x, self.weights[name + ".weight"], self.weights.get(name + ".bias"))

    def layer_norm(self, name, x):
        weight, bias = self.weights[name + ".weight"], self.weights[name + ".bias"]
        return F.layer_norm(x, x.shape[-1:], weight, bias, 1e-6)

    def rms_norm(self, name, x):
        x = x.float()
        return self.weights[name + ".weight"] * (x * torch.rsqrt(x.pow(2).mean(-1, keepdim=True) + 1e-5))

    def heads(self, name, x, width):
        return self.linear(name, x).unflatten(-1, (-1, width))

    def picture(self, pixels):
        """The embeddings of pixels (batch, 3, height, width) from 0 to 1."""
        d = self.d
        height, width = pixels.shape[2:]
        ratio = max(width, height) / d.image
        size = (int(height / ratio), int(width / ratio))
        pixels = F.interpolate(pixels, size=size, mode="bilinear", align_corners=False)
        pixels = F.pad(pixels, (d.image - size[1], 0, d.image - size[0], 0)) * 2 - 1
        name = VISION + "embeddings.patch_embedding"
        x = F.conv2d(pixels, self.weights[name + ".weight"], self.weights[name + ".bias"], stride=d.patch)
        x = x.flatten(2).transpose(1, 2) + self.weights[VISION + "embeddings.position_embedding.weight"]
        for i in range(d.vision_layers):
            layer = f"{VISION}encoder.layers.{i}."
            normed = self.layer_norm(layer + "layer_norm1", x)
            q, k, v = (
                self.heads(f"{layer}self_attn.{name}_proj", normed, d.vision // d.vision_heads).transpose(1, 2) for name in "qkv"
            )
            seen = F.scaled_dot_product_attention(q, k, v)
            x = x + self.linear(layer + "self_attn.out_proj", seen.transpose(1, 2).flatten(2))
            mlp = self.linear(layer + "mlp.fc1", self.layer_norm(layer + "layer_norm2", x))
            x = x + self.linear(layer + "mlp.fc2", F.gelu(mlp, approximate="tanh"))
        x = self.layer_norm(VISION + "post_layernorm", x)
        # Squares of neighbouring patches become one token.
        side, s = d.image // d.patch, d.shuffle
        x = x.unflatten(1, (side // s, s, side // s, s)).transpose(2, 3).flatten(3).flatten(1, 2)
        return self.linear(CONNECTOR, x) * d.text**0.5

    def rotate(self, x, positions):
        """RoPE of x (batch, tokens, heads, width), by halves, in float32."""
        half = x.shape[-1] // 2
        periods = 10_000 ** ((2 / x.shape[-1]) * torch.arange(half, dtype=torch.float32, device=x.device))
        angles = (positions[..., None].float() / periods)[:, :, None]
        a, b = x.float().split(half, dim=-1)
        return torch.cat([a * angles.cos() - b * angles.sin(), b * angles.cos() + a * angles.sin()], -1)

    def attend(self, q, k, v, mask):
        groups = self.d.heads // self.d.kv_heads
        k, v = (x.repeat_interleave(groups, dim=2).transpose(1, 2) for x in (k, v))
        least = torch.zeros(mask.shape, dtype=v.dtype, device=v.device).masked_fill(~mask, torch.finfo(v.dtype).min)
        q, k = q.transpose(1, 2).to(v.dtype), k.to(v.dtype)
        return F.scaled_dot_product_attention(q, k, v, attn_mask=least[:, None]).transpose(1, 2).flatten(2)

    def rest_of_layer(self, layer, x, seen):
        x = x + self.linear(layer + "self_attn.o_proj", seen)
        normed = self.rms_norm(layer + "post_attention_layernorm", x)
        gate = F.silu(self.linear(layer + "mlp.gate_proj", normed))
        return x + self.linear(layer + "mlp.down_proj", gate * self.linear(layer + "mlp.up_proj", normed))

    def loss(self, batch):
        d = self.d
        pictures = [self.picture(pixels) for pixels in batch.pictures]
        words = F.embedding(batch.tokens, self.weights[TEXT + "embed_tokens.weight"]) * d.text**0.5
        prefix = torch.cat([*pictures, words, self.linear("model.state_proj", batch.state)[:, None]], 1)

        at = batch.time[:, None, None]
        noisy = at * batch.noise + (1 - at) * batch.actions
        share = torch.linspace(0, 1, d.expert // 2, dtype=torch.float64, device=noisy.device)
        angles = batch.time[:, None].double() * (2 * math.pi / (0.004 * (4.0 / 0.004) ** share))
        moment = torch.cat([angles.sin(), angles.cos()], 1).float()[:, None].expand(-1, d.chunk, -1)
        actions = torch.cat([self.linear("model.action_in_proj", noisy), moment], 2)
        actions = self.linear("model.action_time_mlp_out", F.silu(self.linear("model.action_time_mlp_in", actions)))

        # Pictures and words see one another; the state, and then each action, begins a block that sees the blocks before it.
        size, first, known = prefix.shape[0], prefix.shape[1], prefix.shape[1] - 1
        valid = torch.ones(size, first + d.chunk, dtype=torch.bool, device=noisy.device)
        shown = [present[:, None].expand(-1, picture.shape[1]) for present, picture in zip(batch.present, pictures)]
        valid[:, :known] = torch.cat([*shown, batch.token_mask], 1)
        block = torch.zeros(first + d.chunk, device=noisy.device)
        block[known:] = torch.arange(1, d.chunk + 2, device=noisy.device)
        mask = (block[None, :] <= block[:, None])[None] & valid[:, None, :] & valid[:, :, None]
        positions = valid.cumsum(1) - 1

        for i in range(d.layers):
            text, expert = f"{TEXT}layers.{i}.", f"{EXPERT}layers.{i}."
            normed = self.rms_norm(text + "input_layernorm", prefix)
            q, k, v = (self.heads(f"{text}self_attn.{name}_proj", normed, d.head) for name in "qkv")
            normed = self.rms_norm(expert + "input_layernorm", actions)
            query = self.heads(expert + "self_attn.q_proj", normed, d.head)
            if i % 2 == 0:
                key, value = (self.heads(f"{expert}self_attn.{name}_proj", normed, d.head) for name in "kv")
                q, k = (self.rotate(torch.cat(both, 1), positions) for both in ((q, query), (k, key)))
                both = self.attend(q, k, torch.cat([v, value], 1), mask)
                seen, by_actions = both[:, :first], both[:, first:]
            else:
                q, k = (self.rotate(x, positions[:, :first]) for x in (q, k))
                seen = self.attend(q, k, v, mask[:, :first, :first])
                key, value = (
                    self.heads(f"{expert}self_attn.{name}_proj", x.flatten(2), d.head) for name, x in (("k", k), ("v", v))
                )
                start = positions[:, first:] - positions[:, first : first + 1]
                by_actions = self.attend(self.rotate(query, start), key, value, mask[:, first:, :first])
            prefix = self.rest_of_layer(text, prefix, seen)
            actions = self.rest_of_layer(expert, actions, by_actions)
        velocity = self.linear("model.action_out_proj", self.rms_norm(EXPERT + "norm", actions))
        return F.mse_loss(velocity.float(), batch.noise - batch.actions)


def random_batch(d, size, device):
    height, width = (480, 640) if d is FULL else (48, 64)
    return SimpleNamespace(
        pictures=[torch.rand(size, 3, height, width, device=device) for _ in range(2)],
        present=[torch.ones(size, dtype=torch.bool, device=device) for _ in range(2)],
        tokens=torch.randint(0, 100, (size, 48), device=device),
        token_mask=torch.ones(size, 48, dtype=torch.bool, device=device),
        state=torch.randn(size, d.padded, device=device),
        actions=torch.randn(size, d.chunk, d.padded, device=device),
        noise=torch.randn(size, d.chunk, d.padded, device=device),
        time=torch.rand(size, device=device),
    )


def measure(profile, size, steps, device):
    torch.manual_seed(0)
    torch.backends.cuda.matmul.allow_tf32 = True
    d = {"tiny": TINY, "full": FULL}[profile]
    step = Step(d, random_weights(d, device))
    parameters = list(step.trained.values())
    optimizer = torch.optim.AdamW(parameters, lr=1e-4, betas=(0.9, 0.95), eps=1e-8, weight_decay=1e-10)
    batch = random_batch(d, size, device)
    seconds = []
    for _ in range(steps + 1):
        started = time.perf_counter()
        with torch.autocast(device, dtype=torch.bfloat16, enabled=device != "cpu"):
            loss = step.loss(batch)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(parameters, 10.0)
        optimizer.step()
        optimizer.zero_grad()
        if device != "cpu":
            torch.cuda.synchronize()
        seconds.append(time.perf_counter() - started)
    line = {
        "side": "torch", "profile": profile, "batch": size, "what": "whole", "steps": steps,
        "step_seconds": statistics.median(seconds[1:]), "trained_parameters": sum(p.numel() for p in parameters),
        "loss": loss.item(), "device": device, "torch": torch.__version__,
        "gpu_memory_bytes": torch.cuda.max_memory_allocated() if device != "cpu" else None,
    }  # fmt: skip
    print(json.dumps(line))


def tensors(path):
    """The tensors of a safetensors file."""
    data = path.read_bytes()
    length = int.from_bytes(data[:8], "little")
    kinds = {"F32": torch.float32, "I64": torch.int64, "BOOL": torch.bool}
    read = {}
    for name, of in json.loads(data[8 : 8 + length]).items():
        if name != "__metadata__":
            start, end = (8 + length + offset for offset in of["data_offsets"])
            read[name] = torch.frombuffer(bytearray(data[start:end]), dtype=kinds[of["dtype"]]).reshape(of["shape"])
    return read


def check(fixture):
    weights, inputs, outputs, wanted = (
        tensors(fixture / f"{name}.safetensors") for name in ("weights", "inputs", "outputs", "grads")
    )
    step = Step(TINY, {name: weights[name] for name in shapes(TINY)})
    loss = step.loss(
        SimpleNamespace(
            pictures=[inputs[f"batch.observation.images.camera{i}"] for i in (1, 2)],
            present=[outputs[f"prepared.image_mask.{i}"] for i in (0, 1)],
            tokens=inputs["batch.observation.language.tokens"],
            token_mask=inputs["batch.observation.language.attention_mask"],
            state=outputs["prepared.state"],
            actions=outputs["prepared.action"],
            noise=inputs["noise"],
            time=inputs["time"],
        )
    )
    loss.backward()
    grads = {name: parameter.grad for name, parameter in step.trained.items()}
    if grads.keys() != wanted.keys():
        sys.exit(f"other parameters are trained: {sorted(grads.keys() ^ wanted.keys())}")
    apart = {
        "loss": abs(loss.item() / outputs["loss"].item() - 1),
        "gradients": max(((grads[name] - wanted[name]).norm() / wanted[name].norm()).item() for name in wanted),
    }
    print(json.dumps(apart))
    if max(apart.values()) > 1e-4:
        sys.exit("this is not LeRobot's step")


if len(sys.argv) == 3 and sys.argv[1] == "check":
    check(Path(sys.argv[2]))
elif len(sys.argv) in (4, 5):
    measure(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4] if len(sys.argv) > 4 else "cpu")
else:
    sys.exit(__doc__)
