//! `--recordings-like`: rules for recordings, taken from one recording.

use crate::dataset::RecordingName;
use anyhow::Result;
use zk0_lerobot::dataset::{Dataset, JointUnit};
use zk0_protocol::recording_rules::{AgreedUnit, RecordingRules};

/// The rules that this recording satisfies. Warns of what it leaves to the nodes.
pub fn rules_of(recording: &RecordingName) -> Result<RecordingRules> {
    let dataset = recording.open()?;
    Ok(RecordingRules {
        joint_unit: unit(&dataset),
        joints: joints(&dataset),
        cameras: cameras(&dataset),
        fps: Some(dataset.fps()),
    })
}

fn unit(dataset: &Dataset) -> Option<AgreedUnit> {
    let (unit, why) = dataset.joint_unit();
    match unit {
        JointUnit::Degrees => Some(AgreedUnit::Degrees),
        JointUnit::MinusToPlus100 => Some(AgreedUnit::MinusToPlus100),
        JointUnit::Unclear => {
            tracing::warn!("the recording does not show its joints' unit, so the rules do not state one: {why}");
            None
        }
    }
}

fn joints(dataset: &Dataset) -> Vec<String> {
    let (state, action) = (&dataset.info().state.names, &dataset.info().action.names);
    if state.is_empty() || state != action {
        tracing::warn!("the recording does not name the same joints for states and actions, so the rules do not state their order");
        return Vec::new();
    }
    state.clone()
}

fn cameras(dataset: &Dataset) -> Vec<String> {
    let mut names: Vec<_> = dataset.cameras().iter().map(|c| c.name.clone()).collect();
    names.sort();
    names
}
