//! Repeats the comparisons with candle's operations in place of the kernels, as a GPU computes. The tolerances are the same.

use zk0_smolvla::policy::model::kernels::without;

use super::{acting, expert, gradients, prefix, sampling, steps, units};

#[test]
fn the_frozen_half() {
    without(|| {
        units::rotary_embedding();
        prefix::vision_from_pixels_to_tokens();
        prefix::prefix_embeddings_and_cache();
    });
}

#[test]
fn the_expert_and_its_losses() {
    without(|| {
        expert::expert_from_noise_to_velocity();
        expert::losses_under_both_rules();
        expert::loss_from_samples_without_padding();
    });
}

#[test]
fn gradients_of_every_trainable_tensor() {
    without(|| {
        gradients::gradients_of_the_plain_loss();
        gradients::gradients_of_the_valid_only_loss();
        gradients::gradients_by_way_of_the_state_token_alone();
    });
}

#[test]
fn optimiser_steps() {
    without(steps::weights_after_optimiser_steps);
}

#[test]
fn actions() {
    without(|| {
        sampling::sampled_actions();
        acting::action_chunks_from_observations();
    });
}
