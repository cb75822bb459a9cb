//! How far the fixed-point loss is from the float32 loss.

mod fidelity;
