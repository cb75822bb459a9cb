//! Mode `checked`: the prover hints the matrix products, and the guest checks them with random coefficients, as Freivalds
//! proposed in 1977. `SOUNDNESS.md` argues why this is sound.

pub mod checked;
pub mod coefficients;
pub mod field;
pub mod hints;
pub mod projection;
