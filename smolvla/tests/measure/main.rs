//! How far the fixed-point loss is from the float32 loss.

#[path = "../reference/mod.rs"]
mod reference;

mod fidelity;
