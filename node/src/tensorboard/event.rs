//! The messages of TensorBoard's `event.proto` and `summary.proto` that curves need, with TensorBoard's field numbers.

use prost::Message as _;

/// The format's version, in a file's first event.
pub const VERSION: &str = "brain.Event:2";

/// One record of a file: a version, a summary or a session's start.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Event {
    /// Seconds since 1970.
    #[prost(double, tag = "1")]
    pub wall_time: f64,
    /// Optimiser steps.
    #[prost(int64, tag = "2")]
    pub step: i64,
    /// The format, in a file's first event.
    #[prost(string, optional, tag = "3")]
    pub file_version: Option<String>,
    /// Values of metrics.
    #[prost(message, optional, tag = "5")]
    pub summary: Option<Summary>,
    /// The start of a session.
    #[prost(message, optional, tag = "7")]
    pub session_log: Option<SessionLog>,
}

/// Values of metrics at one step.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Summary {
    /// One value a metric.
    #[prost(message, repeated, tag = "1")]
    pub values: Vec<Value>,
}

/// The value of one metric.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Value {
    /// The metric.
    #[prost(string, tag = "1")]
    pub tag: String,
    /// Its value.
    #[prost(float, optional, tag = "2")]
    pub simple_value: Option<f32>,
}

/// A session's event.
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct SessionLog {
    /// 1 for its start.
    #[prost(int32, tag = "1")]
    pub status: i32,
}

/// [`SessionLog::status`] of a start.
const START: i32 = 1;

impl Event {
    /// The first event of a file.
    pub fn version(wall_time: f64) -> Self {
        Self {
            wall_time,
            file_version: Some(VERSION.into()),
            ..Self::default()
        }
    }

    /// Training goes on with `step`. Readers drop what earlier files have for this step and later ones.
    pub fn restart(wall_time: f64, step: u64) -> Self {
        Self {
            wall_time,
            step: signed(step),
            session_log: Some(SessionLog { status: START }),
            ..Self::default()
        }
    }

    /// Values of metrics at `step`.
    pub fn scalars(wall_time: f64, step: u64, values: &[(&str, f64)]) -> Self {
        let value = |(tag, value): &(&str, f64)| Value {
            tag: (*tag).to_owned(),
            simple_value: Some(*value as f32),
        };
        Self {
            wall_time,
            step: signed(step),
            summary: Some(Summary {
                values: values.iter().map(value).collect(),
            }),
            ..Self::default()
        }
    }

    /// The message's bytes.
    pub fn bytes(&self) -> Vec<u8> {
        self.encode_to_vec()
    }
}

fn signed(step: u64) -> i64 {
    i64::try_from(step).unwrap_or(i64::MAX)
}
