//! Which unit a recording's joints look like. No file of a recording states it: LeRobot records degrees or −100 to 100
//! (`use_degrees`, whose default has changed), and the values alone can show which.
//!
//! LeRobot 0.6.1 (`_normalize` in `motors/motors_bus.py`) computes degrees from whole steps of the motors' encoders, of which 4095 make
//! a turn, around a middle that may be a half step. It brings −100 to 100 back to these ends when a motor stands beyond them.

use serde::Serialize;

use crate::dataset::Dataset;

/// Half a step of the encoder, in degrees.
const HALF_STEP: f32 = 180.0 / 4095.0;
/// How far a value may be from a whole number of half steps: float32 rounds more finely.
const SLACK: f32 = 0.02;

/// A unit of joints, the gripper left out: LeRobot always records 0 to 100 for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum JointUnit {
    /// Degrees.
    Degrees,
    /// −100 at one end of a joint's way and 100 at the other.
    #[serde(rename = "-100-to-100")]
    MinusToPlus100,
    /// The values do not show it.
    Unclear,
}

impl JointUnit {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Degrees => "degrees",
            Self::MinusToPlus100 => "-100 to 100",
            Self::Unclear => "unclear",
        }
    }
}

impl Dataset {
    /// The unit that the recorded states look like, and why.
    pub fn joint_unit(&self) -> (JointUnit, String) {
        let names = &self.info().state.names;
        let is_gripper = |dim: usize| match names.get(dim) {
            Some(name) => name.contains("gripper"),
            // LeRobot's arms have it at the end.
            None => dim + 1 == self.info().state.dim,
        };
        let joints = (0..self.info().state.dim).filter(|dim| !is_gripper(*dim));
        let values = (0..self.len()).filter_map(|frame| self.state(frame));
        let of_joint = |dim: usize| values.clone().map(move |row| row[dim]);
        let name = |dim: usize| {
            names
                .get(dim)
                .cloned()
                .unwrap_or_else(|| format!("joint {dim}"))
        };
        let mut whole_steps = true;
        let mut end = None;
        for dim in joints {
            if let Some(beyond) = of_joint(dim).find(|value| value.abs() > 100.0) {
                let why = format!("{} reaches {beyond:.1}", name(dim));
                return (JointUnit::Degrees, why);
            }
            whole_steps &= of_joint(dim).all(|value| {
                let steps = value / HALF_STEP;
                (steps - steps.round()).abs() < SLACK
            });
            end = end.or(of_joint(dim)
                .find(|value| value.abs() == 100.0)
                .map(|at| (dim, at)));
        }
        match (whole_steps, end) {
            (true, _) => (
                JointUnit::Degrees,
                "all values are whole steps of the motors' encoders, of 360/4095 degrees".into(),
            ),
            (false, Some((dim, at))) => (
                JointUnit::MinusToPlus100,
                format!("{} stops at {at}, and no joint goes further", name(dim)),
            ),
            (false, None) => (
                JointUnit::Unclear,
                "no joint goes beyond 100 or stops there, and values are not steps of the motors' encoders".into(),
            ),
        }
    }
}
