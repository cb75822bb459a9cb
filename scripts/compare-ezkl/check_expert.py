"""Checks expert.py against LeRobot's own losses for its tiny SmolVLA, tests/fixtures/smolvla_tiny: the model that is
proven is the model that is meant."""

import json
import struct
from pathlib import Path

import numpy as np
import torch

from expert import Expert, time_embedding

FIXTURE = Path(__file__).resolve().parents[2] / "tests/fixtures/smolvla_tiny"
TYPES = {"F32": np.float32, "BOOL": np.bool_}
DIMS = {
    "expert_width": 54,
    "expert_mlp": 256,
    "heads": 6,
    "kv_heads": 2,
    "head_dim": 12,
    "layers": 4,
    "self_attn_every": 2,
    "chunk": 10,
    "max_action_dim": 32,
    "action_dim": 6,
}
# LeRobot's names, by the beginnings of ours.
LAYERS = "model.vlm_with_expert.lm_expert."
NAMES = {
    "action_in": "model.action_in_proj",
    "time_in": "model.action_time_mlp_in",
    "time_out": "model.action_time_mlp_out",
    "action_out": "model.action_out_proj",
    "norm": LAYERS + "norm",
    "input_norm": "input_layernorm",
    "mlp_norm": "post_attention_layernorm",
    **{part: f"self_attn.{part}_proj" for part in "qkvo"},
    **{part: f"mlp.{part}_proj" for part in ("gate", "up", "down")},
}


def read(name):
    """The float32 and boolean tensors of a safetensors file."""
    data = (FIXTURE / f"{name}.safetensors").read_bytes()
    (length,) = struct.unpack("<Q", data[:8])
    header, data = json.loads(data[8 : 8 + length]), data[8 + length :]
    header.pop("__metadata__", None)
    tensors = {}
    for key, value in header.items():
        if value["dtype"] in TYPES:
            start, end = value["data_offsets"]
            array = np.frombuffer(data[start:end], TYPES[value["dtype"]]).reshape(value["shape"])
            tensors[key] = torch.from_numpy(array.copy())
    return tensors


def lerobot_name(name):
    *layer, part, kind = name.split(".")
    return ".".join([LAYERS + ".".join(layer), NAMES[part], kind] if layer else [NAMES[part], kind])


def main():
    weights, inputs, outputs = read("weights"), read("inputs"), read("outputs")
    worst = 0.0
    for sample in range(2):
        valid = outputs["prefix_pad_masks"][sample]
        cache = [[outputs[f"cache.{i}.{part}"][sample][valid].flatten(1) for part in ("key", "value")] for i in range(4)]
        expert = Expert({**DIMS, "max_prefix": int(valid.sum())})
        state = expert.state_dict()
        state.update({name: weights[lerobot_name(name)] for name, _ in expert.named_parameters()})
        expert.load_state_dict(state)
        not_pad = ~inputs["batch.action_is_pad"][sample]
        time = inputs["time"][sample].reshape(1, 1)
        with torch.no_grad():
            found = expert(
                torch.stack([torch.stack(layer) for layer in cache]),
                outputs["prepared.action"][sample],
                inputs["noise"][sample],
                time,
                time_embedding(time, DIMS["expert_width"]),
                not_pad[:, None].float(),
            )
        found = found.item() / (int(not_pad.sum()) * DIMS["action_dim"])
        expected = outputs["per_sample_loss_valid_only"][sample].item()
        print(f"sample {sample}: prefix {int(valid.sum())}, frames {int(not_pad.sum())}, loss {found:.7f}, LeRobot {expected:.7f}")
        worst = max(worst, abs(found / expected - 1))
    print(f"worst relative difference {worst:.1e}")
    if not worst < 1e-5:
        raise SystemExit("expert.py does not compute LeRobot's loss")


if __name__ == "__main__":
    main()
