//! The evaluation, step by step: what holds of each step's values.

pub mod attention;
pub mod layers;
pub mod linear;
pub mod norm;
mod outcome;
mod projections;
