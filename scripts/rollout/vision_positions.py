"""The positions of image patches in float32.

transformers 4.55 and later computes the positions 0, 0, 1, …, n-2 along each axis where it computes in float32, instead of 0, 1, …, n-1 as before, and
as it still does for the published policy in bfloat16 (issue 41190 of transformers; tests/fixtures/README.md, "Position ids"). zk0 trains with the latter.
"""

import torch
from transformers.models.smolvlm.modeling_smolvlm import SmolVLMVisionEmbeddings


def put_right():
    """Makes transformers count the patches of whole pictures one by one. Pictures that are partly padding do not occur here."""

    def forward(self, pixel_values, patch_attention_mask):
        patches = self.patch_embedding(pixel_values)
        batch, _, height, width = patches.shape
        if not bool(patch_attention_mask.all()):
            raise ValueError("a picture is partly padding, for which these positions are not right")
        rows, columns = torch.arange(height, device=patches.device), torch.arange(width, device=patches.device)
        # The table of positions has as many columns as the largest picture has patches in a row.
        numbers = (rows[:, None] * self.num_patches_per_side + columns).flatten().expand(batch, -1)
        return patches.flatten(2).transpose(1, 2) + self.position_embedding(numbers)

    SmolVLMVisionEmbeddings.forward = forward
