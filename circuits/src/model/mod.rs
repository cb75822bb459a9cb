//! The evaluation in fixed point: what it takes (specification, weights, sample, draw) and how it gets from there to a loss.

pub mod arithmetic;
pub mod draw;
pub mod elementwise;
pub mod eval;
pub mod layout;
pub mod linear;
pub mod mode;
pub mod multiply;
pub mod quantise;
pub mod sample;
pub mod site;
pub mod spec;
pub mod weights;
