//! Watching a pass of the expert: the values at every place that the fixed-point evaluation narrows ([`Site`]).

use candle_core::Tensor;

use crate::error::Result;

pub use zk0_circuits::model::site::Site;

/// Called with each place of a pass and the values there, in the order they are computed. They are those of the whole
/// batch, frames that are padding included.
pub type Observer<'a> = dyn FnMut(Site, &Tensor) -> Result<()> + 'a;

/// Looks at nothing: for passes that nobody watches.
pub fn ignore(_: Site, _: &Tensor) -> Result<()> {
    Ok(())
}
