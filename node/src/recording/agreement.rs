//! Whether a recording fits the rules of its network.

use crate::error::ParticipantError;
use crate::recording::OpenRecording;
use std::collections::BTreeSet;
use zk0_lerobot::dataset::{Dataset, JointUnit};
use zk0_protocol::recording_rules::{AgreedUnit, RecordingRules};
use zk0_smolvla::PolicyConfig;

impl OpenRecording<'_> {
    /// Checks the recording against the rules. Warns of what the recording does not show.
    ///
    /// # Errors
    /// [`ParticipantError::OtherRecording`] names everything that differs.
    pub fn check(&self, rules: &RecordingRules) -> Result<(), ParticipantError> {
        check(rules, &self.dataset, &self.config)
    }
}

/// [`OpenRecording::check`] of an open dataset, for a policy of this configuration.
///
/// # Errors
/// As [`OpenRecording::check`].
pub fn check(
    rules: &RecordingRules,
    dataset: &Dataset,
    config: &PolicyConfig,
) -> Result<(), ParticipantError> {
    let leaves_out = !config.camera_names.is_empty();
    let differences = differences(rules, dataset, leaves_out);
    if differences.is_empty() {
        Ok(())
    } else {
        Err(ParticipantError::OtherRecording(differences.join("; ")))
    }
}

/// All differences, in words. A policy that names its cameras leaves others out (`leaves_out`).
fn differences(rules: &RecordingRules, dataset: &Dataset, leaves_out: bool) -> Vec<String> {
    let mut found = Vec::new();
    if let Some(fps) = rules.fps.filter(|fps| *fps != dataset.fps()) {
        let own = dataset.fps();
        found.push(format!("it has {own} frames per second, not {fps}"));
    }
    found.extend(rules.joint_unit.and_then(|unit| other_unit(unit, dataset)));
    let (state, action) = (&dataset.info().state, &dataset.info().action);
    for (what, feature) in [("states", state), ("actions", action)] {
        match (rules.joints.is_empty(), feature.names.is_empty()) {
            (false, true) => tracing::warn!(
                "the recording does not name the joints of its {what}; the network's are {:?}, in this order",
                rules.joints
            ),
            (false, false) if feature.names != rules.joints => found.push(format!(
                "the joints of its {what} are {:?}, not {:?}",
                feature.names, rules.joints
            )),
            _ => {}
        }
    }
    if !rules.cameras.is_empty() {
        let own: BTreeSet<&String> = dataset.cameras().iter().map(|c| &c.name).collect();
        let asked: BTreeSet<&String> = rules.cameras.iter().collect();
        let fits = if leaves_out {
            own.is_superset(&asked)
        } else {
            own == asked
        };
        if !fits {
            found.push(format!(
                "its cameras are {own:?}, not {asked:?} (--rename-map gives cameras other names)"
            ));
        }
    }
    found
}

fn other_unit(asked: AgreedUnit, dataset: &Dataset) -> Option<String> {
    let wanted = match asked {
        AgreedUnit::Degrees => JointUnit::Degrees,
        AgreedUnit::MinusToPlus100 => JointUnit::MinusToPlus100,
    };
    let (unit, why) = dataset.joint_unit();
    if unit == JointUnit::Unclear {
        let wanted = wanted.name();
        tracing::warn!("the recording does not show its joints' unit, which has to be {wanted} in this network: {why}");
        return None;
    }
    let (found, wanted_name) = (unit.name(), wanted.name());
    (unit != wanted).then(|| format!("its joints are in {found}, not in {wanted_name} ({why})"))
}
