//! Euler steps of the velocity field, from noise to actions.

use candle_core::Tensor;
use zk0_smolvla::policy::model::sampling::sample_actions_observed;

use super::case::{Case, HIDDEN, SAMPLED};
use crate::reference::{check, close, distance, is_committed, numbers};

/// Of a velocity that was sampled along: the bound of hidden states. Only the last one, that of the state which all steps before
/// made, may be as far off as sampled actions, in other folders than the first. In the second it is off by 1.2e-4 (4.6e-5 by
/// candle's operations), and LeRobot's is itself 3.5e-5 off what LeRobot computes in double precision; 7.4e-5 with another epsilon
/// of its norms.
fn velocity_tolerance(step: usize, steps: usize) -> f64 {
    match step + 1 == steps && !is_committed() {
        true => SAMPLED,
        false => HIDDEN,
    }
}

#[test]
pub fn sampled_actions() {
    let case = Case::read();
    let (out, steps) = (&case.outputs, case.lerobot.num_steps);
    let (states, velocities) = (out.tensor("sample.x_t"), out.tensor("sample.v_t"));
    assert_eq!(states.dim(0).unwrap(), steps);
    let mut step = 0;
    let noise = case.inputs.tensor("sample_noise");
    let actions =
        sample_actions_observed(&case.expert, &case.cache(), &noise, steps, &mut |euler| {
            let compare = |name: &str, found: &Tensor, all: &Tensor, tolerance| {
                let expected = numbers(&all.get(step)?);
                let name = format!("{name} {step}");
                check(&name, distance(&numbers(found), &expected), tolerance);
                Ok::<_, zk0_smolvla::PolicyError>(())
            };
            compare("sample.x_t", euler.x_t, &states, SAMPLED)?;
            let tolerance = velocity_tolerance(step, steps);
            compare("sample.v_t", euler.v_t, &velocities, tolerance)?;
            step += 1;
            Ok(())
        })
        .unwrap();
    assert_eq!(step, steps);
    close(out, "sample.actions", &actions, SAMPLED);
    let chunk = actions.narrow(2, 0, case.config().action_dim).unwrap();
    close(out, "sample.action_chunk", &chunk, SAMPLED);
}
