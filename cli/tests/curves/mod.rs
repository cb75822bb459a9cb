//! `--tensorboard`: the curves of runs, nodes and simulations, as TensorBoard reads them.

mod node;
mod simulation;
mod train;

use std::collections::BTreeMap;

/// A curve: values by steps.
type Curve = BTreeMap<i64, f32>;

/// The names of curves.
fn names(curves: &BTreeMap<String, Curve>) -> Vec<&str> {
    curves.keys().map(String::as_str).collect()
}
