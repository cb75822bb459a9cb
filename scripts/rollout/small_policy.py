#!/usr/bin/env python3
"""Writes a small SmolVLA policy with random weights, as LeRobot itself saves one, for the recordings that `record.py` makes.

    small_policy.py FOLDER

`FOLDER/policy` is the policy folder: `zk0 train --policy` and `zk0 aggregator init --policy` take it. `FOLDER/vlm` is the vision-language model that the policy
names: its configuration and a tokenizer of the task's words. LeRobot fetches that of a published policy from the Hub. Nothing is fetched here.
"""

import argparse
import shutil
from pathlib import Path

# First, because these say what to do if something is not installed.
from recording import ACTION, IMAGE, STATE
from simulator import JOINTS, SIDE, TASK

import torch
from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.policies.smolvla.configuration_smolvla import SmolVLAConfig
from lerobot.policies.smolvla.modeling_smolvla import SmolVLAPolicy
from lerobot.policies.smolvla.processor_smolvla import make_smolvla_pre_post_processors
from tokenizers import Tokenizer, models, normalizers, pre_tokenizers
from transformers import PreTrainedTokenizerFast, SmolVLMConfig, SmolVLMImageProcessor, SmolVLMProcessor, SmolVLMVideoProcessor

VISION = {"hidden_size": 64, "intermediate_size": 128, "num_hidden_layers": 2, "num_attention_heads": 4, "image_size": 128, "patch_size": 16}
TEXT = {
    "model_type": "llama", "vocab_size": 128, "hidden_size": 96, "intermediate_size": 192, "num_hidden_layers": 4, "num_attention_heads": 6,
    "num_key_value_heads": 2, "head_dim": 16, "rms_norm_eps": 1e-5, "pad_token_id": 2, "bos_token_id": 1, "eos_token_id": 2,
}  # fmt: skip
SPECIAL = {"unk_token": "<unk>", "bos_token": "<s>", "pad_token": "<pad>", "eos_token": "<pad>"}
# LeRobot asks for the numbers of these, but the policy does not use them.
IMAGE_TOKENS = {"image_token": "<image>", "fake_image_token": "<fake_token_around_image>", "global_image_token": "<global-img>"}


def tokenizer():
    words = sorted(set(TASK.lower().replace(".", "").split()))
    names = ["<unk>", "<s>", "<pad>", *IMAGE_TOKENS.values(), "<end_of_utterance>", ".", *words]
    made = Tokenizer(models.WordLevel({name: number for number, name in enumerate(names)}, unk_token="<unk>"))
    made.normalizer = normalizers.Lowercase()
    made.pre_tokenizer = pre_tokenizers.Whitespace()
    return PreTrainedTokenizerFast(tokenizer_object=made, extra_special_tokens=IMAGE_TOKENS, **SPECIAL)


def write_vlm(folder):
    SmolVLMConfig(vision_config=VISION, text_config=TEXT, scale_factor=2, image_token_id=3, pad_token_id=2).save_pretrained(folder)
    SmolVLMProcessor(SmolVLMImageProcessor(), tokenizer(), SmolVLMVideoProcessor(), chat_template=None).save_pretrained(folder)


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("folder", type=Path)
    arguments.add_argument("--seed", type=int, default=0)
    options = arguments.parse_args()
    vlm, policy = options.folder.resolve() / "vlm", options.folder.resolve() / "policy"
    write_vlm(vlm)
    torch.manual_seed(options.seed)
    vector = (len(JOINTS),)
    config = SmolVLAConfig(
        input_features={
            STATE: PolicyFeature(FeatureType.STATE, vector),
            IMAGE: PolicyFeature(FeatureType.VISUAL, (3, SIDE, SIDE)),
        },
        output_features={ACTION: PolicyFeature(FeatureType.ACTION, vector)},
        chunk_size=10, n_action_steps=5, max_state_dim=8, max_action_dim=8, resize_imgs_with_padding=(SIDE, SIDE), tokenizer_max_length=12,
        vlm_model_name=str(vlm), load_vlm_weights=False, num_vlm_layers=4, expert_width_multiplier=0.75, device="cpu", push_to_hub=False,
    )  # fmt: skip
    made = SmolVLAPolicy(config)
    made.save_pretrained(policy)
    for processor in make_smolvla_pre_post_processors(config):
        processor.save_pretrained(policy)
    # zk0 finds the dimensions and the tokenizer beside the weights.
    shutil.copy(vlm / "config.json", policy / "vlm_config.json")
    shutil.copy(vlm / "tokenizer.json", policy / "tokenizer.json")
    trained = sum(weights.numel() for weights in made.parameters() if weights.requires_grad)
    print(f"{policy}: {sum(weights.numel() for weights in made.parameters()):,} weights, {trained:,} of them trained")


if __name__ == "__main__":
    main()
