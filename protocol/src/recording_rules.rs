//! What recordings must agree in, because one policy learns from all of them. The ledger shows no recording, so each node checks
//! its own before it registers and before each round. An auditor needs the recording to check it.

use borsh::{BorshDeserialize, BorshSerialize};
use serde::{Deserialize, Serialize};

/// Most cameras, and most joints, in the rules.
pub const MAX_NAMES: usize = 64;

/// Longest name of a camera or a joint, in bytes.
pub const MAX_NAME_BYTES: usize = 128;

/// Most frames per second in the rules.
pub const MAX_FPS: u32 = 1000;

/// What recordings must agree in. `None` or empty leaves it to the nodes.
#[derive(
    Clone, Debug, Default, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize,
)]
#[serde(deny_unknown_fields)]
pub struct RecordingRules {
    /// The unit of the joints, without the gripper.
    pub joint_unit: Option<AgreedUnit>,
    /// The joints' names in the order of states and actions, in LeRobot's form: `shoulder_pan.pos`.
    pub joints: Vec<String>,
    /// The cameras' full names in ascending order, in LeRobot's form: `observation.images.top`.
    pub cameras: Vec<String>,
    /// Frames per second.
    pub fps: Option<u32>,
}

/// A unit of joints.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum AgreedUnit {
    /// Degrees.
    Degrees,
    /// −100 at one end of a joint's range and 100 at the other.
    #[serde(rename = "-100-to-100")]
    MinusToPlus100,
}

impl RecordingRules {
    /// Whether the rules leave everything to the nodes.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Checks every rule. The error names a bad one.
    pub(crate) fn check(&self) -> Result<(), String> {
        for (rule, names) in [("joints", &self.joints), ("cameras", &self.cameras)] {
            if names.len() > MAX_NAMES {
                return Err(format!(
                    "rule recordings.{rule} has {} names; it can have at most {MAX_NAMES}",
                    names.len()
                ));
            }
            let usable = |name: &String| {
                (1..=MAX_NAME_BYTES).contains(&name.len()) && !name.contains(char::is_control)
            };
            if let Some(name) = names.iter().position(|name| !usable(name)) {
                return Err(format!(
                    "rule recordings.{rule} has a name (number {name}, counted from 0) that is empty, longer than {MAX_NAME_BYTES} bytes, or holds \
                     control characters"
                ));
            }
        }
        if !self.cameras.is_sorted_by(|one, next| one < next) {
            return Err(
                "rule recordings.cameras names cameras twice or not in ascending order".into(),
            );
        }
        match self.fps {
            Some(fps) if !(1..=MAX_FPS).contains(&fps) => Err(format!(
                "rule recordings.fps is {fps}; it has to be 1 to {MAX_FPS}"
            )),
            _ => Ok(()),
        }
    }
}
