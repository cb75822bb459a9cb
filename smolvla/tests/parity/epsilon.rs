//! The second reference with another epsilon of the text layers' and the expert's norms.

use zk0_smolvla::policy::model::flow;
use zk0_smolvla::policy::model::kernels::gradients::backward;
use zk0_smolvla::policy::model::sampling::sample_actions;

use super::case::{LOSS, SAMPLED};
use super::training::Training;
use crate::reference::{check, distance, is_odd, lerobot, numbers};

/// LeRobot's values come from the folder's `make.py`, run with `"rms_norm_eps": 3e-2`. Its weights and inputs are the same then.
#[test]
pub fn norms_of_another_epsilon() {
    if !is_odd() {
        return; // The process that `other_folder` starts runs this test
    }
    let mut lerobot = lerobot();
    lerobot.dims.rms_norm_eps = 3e-2;
    let steps = lerobot.num_steps;
    let training = Training::of(lerobot);
    let case = &training.case;
    let losses = training.losses("noise", "time");
    let each = numbers(&losses.flatten_from(1).unwrap().mean(1).unwrap());
    let expected = [2.7335755825042725, 2.6199285984039307, 2.0420968532562256];
    check("per_sample_loss", distance(&each, &expected), LOSS);

    let is_pad = case.inputs.mask("batch.action_is_pad");
    let valid = flow::mean_loss_valid_only(&losses, case.config().action_dim, &is_pad).unwrap();
    let off = (numbers(&valid)[0] - 3.592913866043091).abs();
    check("loss_valid_only", off, LOSS);
    for (loss, expected) in [
        (flow::mean_loss(&losses).unwrap(), 14.349946724586115),
        (valid, 28.358680988798206),
    ] {
        let gradients = backward(&loss).unwrap();
        let of = |variable| numbers(gradients.get(variable).unwrap());
        let squares = training.variables.values().flat_map(|v| of(v));
        let norm = squares.map(|x| x * x).sum::<f64>().sqrt();
        check("norm of the gradient", (norm / expected - 1.0).abs(), 2e-4);
    }

    let noise = case.inputs.tensor("sample_noise");
    let actions = sample_actions(&case.expert, &case.cache(), &noise, steps).unwrap();
    let actions = numbers(&actions);
    let (row, real) = (case.config().max_action_dim, case.config().action_dim);
    let (first, last) = (&actions[..real], &actions[actions.len() - row..][..real]);
    let expected = [
        0.0501369871199131,
        -0.8851138949394226,
        -1.089106559753418,
        1.4838144779205322,
    ];
    check("the first action", distance(first, &expected), SAMPLED);
    let expected = [
        -0.8891250491142273,
        0.24513694643974304,
        -0.9372581839561462,
        -0.2072630524635315,
    ];
    check("the last action", distance(last, &expected), SAMPLED);
}
