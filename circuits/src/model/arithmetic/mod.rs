//! Integer arithmetic that knows nothing of the model: rounding and narrowing, tables of functions, matrix products.

pub mod fixed;
pub mod products;
pub mod tables;
