//! Whether recordings fit a policy, and one another.

use anyhow::{bail, Context, Result};
use zk0_lerobot::dataset::{refuse_different, Dataset};
use zk0_smolvla::frames::cameras::camera_slots;
use zk0_smolvla::PolicyConfig;

/// Refuses recordings that differ in frames per second, joints or cameras, or do not fit the policy, before minutes are spent. Warns of
/// cameras that the policy does not take.
pub fn refuse_unfit(config: &PolicyConfig, datasets: &[Dataset]) -> Result<()> {
    refuse_different(datasets.iter().map(|d| (d.root(), d.info())))?;
    datasets
        .iter()
        .try_for_each(|dataset| fits(config, dataset))
}

fn fits(config: &PolicyConfig, dataset: &Dataset) -> Result<()> {
    let name = dataset.root().display();
    let cameras: Vec<&str> = dataset.cameras().iter().map(|c| c.name.as_str()).collect();
    let slots = camera_slots(config, 0, &cameras).with_context(|| name.to_string())?;
    let left_out = |i: &usize| !slots.contains(&Some(*i));
    let left_out: Vec<&str> = (0..cameras.len())
        .filter(left_out)
        .map(|i| cameras[i])
        .collect();
    if !left_out.is_empty() {
        tracing::warn!(
            "{name}: the policy does not take the cameras {}, so they are not used",
            left_out.join(", ")
        );
    }
    let (state, action) = (dataset.info().state.dim, dataset.info().action.dim);
    if (state, action) != (config.state_dim, config.action_dim) {
        bail!(
            "{name} has {state} state and {action} action dimensions, and the policy takes {} and {}",
            config.state_dim,
            config.action_dim
        );
    }
    Ok(())
}
