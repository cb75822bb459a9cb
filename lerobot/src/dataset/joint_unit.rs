//! Which unit a recording's joints look like. LeRobot records degrees or −100 to 100 (`use_degrees`, whose default has changed), and no
//! file states which: only the values show it.
//!
//! LeRobot 0.6.1 (`_normalize` in `motors/motors_bus.py`) computes degrees from whole encoder steps, 4095 a turn, around a middle that may
//! be a half step. It clips −100 to 100 when a motor stands beyond an end.

use serde::Serialize;

use crate::dataset::Dataset;

/// Half an encoder step, in degrees.
const HALF_STEP: f32 = 180.0 / 4095.0;
/// How far a value may be from a whole number of half steps; float32 is finer.
const SLACK: f32 = 0.02;

/// A unit of joints, without the gripper: LeRobot always records it as 0 to 100.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum JointUnit {
    /// Degrees.
    Degrees,
    /// −100 at one end of a joint's range, 100 at the other.
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
    /// The unit that the states look like, and why.
    pub fn joint_unit(&self) -> (JointUnit, String) {
        let names = &self.info().state.names;
        let is_gripper = |dim: usize| match names.get(dim) {
            Some(name) => name.contains("gripper"),
            // LeRobot's arms have the gripper last.
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
