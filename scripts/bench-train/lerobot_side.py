"""Times LeRobot's own training step of SmolVLA with random weights, and prints one JSON line.

usage: lerobot_side.py FIXTURE tiny|full BATCH STEPS [cpu|cuda]

FIXTURE has policy_config.json and vlm_config.json of the tiny policy; for `full` the published dimensions are put in their
place. On a GPU the pass runs under autocast to bf16, and TF32 is allowed, as LeRobot's own training script does. Nothing is looked
up on the Hub. A step is forward (resizing the pictures included), backward, clipping and AdamW; the
first is not counted.
"""

import json
import resource
import statistics
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import torch
from transformers import AutoConfig, AutoProcessor, SmolVLMConfig

PUBLISHED = {
    "vision_config": {
        "hidden_size": 768,
        "intermediate_size": 3072,
        "num_hidden_layers": 12,
        "num_attention_heads": 12,
        "image_size": 512,
        "patch_size": 16,
    },
    "text_config": {
        "vocab_size": 49280,
        "hidden_size": 960,
        "intermediate_size": 2560,
        "num_hidden_layers": 32,
        "num_attention_heads": 15,
        "num_key_value_heads": 5,
        "head_dim": 64,
    },
    "scale_factor": 4,
}
PUBLISHED_POLICY = {
    "chunk_size": 50,
    "n_action_steps": 50,
    "max_state_dim": 32,
    "max_action_dim": 32,
    "num_vlm_layers": 16,
    "resize_imgs_with_padding": (512, 512),
    "tokenizer_max_length": 48,
    "expert_width_multiplier": 0.75,
}


def policy_of(fixture, profile):
    from lerobot.configs.types import FeatureType, PolicyFeature
    from lerobot.policies.smolvla.configuration_smolvla import SmolVLAConfig
    from lerobot.policies.smolvla.modeling_smolvla import SmolVLAPolicy

    vlm = json.loads((fixture / "vlm_config.json").read_text())
    settings = json.loads((fixture / "policy_config.json").read_text())
    settings.pop("type")
    for features in ("input_features", "output_features"):
        settings[features] = {
            name: PolicyFeature(type=FeatureType(feature["type"]), shape=tuple(feature["shape"]))
            for name, feature in settings[features].items()
        }
    known = SmolVLAConfig.__dataclass_fields__
    settings = {name: value for name, value in settings.items() if name in known and name != "normalization_mapping"}
    if profile == "full":
        for part, values in PUBLISHED.items():
            vlm[part] = {**vlm[part], **values} if isinstance(values, dict) else values
        settings |= PUBLISHED_POLICY
    settings |= {"load_vlm_weights": False, "device": "cpu"}
    # The published tokenizer is not needed: token ids are given.
    AutoConfig.from_pretrained = staticmethod(lambda *_, **__: SmolVLMConfig.from_dict(vlm))
    tokenizer = SimpleNamespace(fake_image_token_id=0, global_image_token_id=1)
    AutoProcessor.from_pretrained = staticmethod(lambda *_, **__: SimpleNamespace(tokenizer=tokenizer))
    return SmolVLAPolicy(SmolVLAConfig(**settings)).float()


def batch_of(policy, profile, size, device):
    height, width = (480, 640) if profile == "full" else (48, 64)
    length = 48
    config = policy.config
    batch = {name: torch.rand(size, 3, height, width) for name in config.image_features}
    batch["observation.language.tokens"] = torch.randint(0, 100, (size, length))
    batch["observation.language.attention_mask"] = torch.ones(size, length, dtype=torch.bool)
    batch["observation.state"] = torch.randn(size, 6)
    batch["action"] = torch.randn(size, config.chunk_size, 6)
    return {name: value.to(device) for name, value in batch.items()}


def main():
    fixture, profile, size, steps = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
    device = sys.argv[5] if len(sys.argv) > 5 else "cpu"
    torch.manual_seed(0)
    torch.backends.cuda.matmul.allow_tf32 = True
    policy = policy_of(fixture, profile).to(device)
    policy.train()
    parameters = [parameter for parameter in policy.parameters() if parameter.requires_grad]
    optimizer = torch.optim.AdamW(parameters, lr=1e-4, betas=(0.9, 0.95), eps=1e-8, weight_decay=1e-10)
    batch = batch_of(policy, profile, size, device)
    seconds = []
    for _ in range(steps + 1):
        started = time.perf_counter()
        with torch.autocast(device, dtype=torch.bfloat16, enabled=device != "cpu"):
            loss, _ = policy.forward(batch)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(parameters, 10.0)
        optimizer.step()
        optimizer.zero_grad()
        if device != "cpu":
            torch.cuda.synchronize()
        seconds.append(time.perf_counter() - started)
    print(
        json.dumps(
            {
                "side": "lerobot",
                "profile": profile,
                "batch": size,
                "what": "whole",
                "steps": steps,
                "step_seconds": statistics.median(seconds[1:]),
                "peak_memory_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss if device == "cpu" else None,
                "trained_parameters": sum(parameter.numel() for parameter in parameters),
                "loss": loss.item(),
                "torch": torch.__version__,
                "threads": torch.get_num_threads(),
            }
        )
    )


main()
