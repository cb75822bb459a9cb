//! Euler steps of the velocity field, from noise to actions.

use candle_core::Tensor;
use zk0_smolvla::act::real_actions;
use zk0_smolvla::model::sampling::sample_actions_observed;

use crate::case::{Case, HIDDEN, SAMPLED};
use crate::reference::{check, close, distance, numbers};

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
            // Later velocities are those of states that are a little off already.
            let tolerance = if step == 0 { HIDDEN } else { SAMPLED };
            compare("sample.v_t", euler.v_t, &velocities, tolerance)?;
            step += 1;
            Ok(())
        })
        .unwrap();
    assert_eq!(step, steps);
    close(out, "sample.actions", &actions, SAMPLED);
    let chunk = real_actions(&actions, case.config().action_dim).unwrap();
    close(out, "sample.action_chunk", &chunk, SAMPLED);
}
