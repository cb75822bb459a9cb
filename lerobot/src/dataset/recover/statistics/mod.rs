//! Statistics as LeRobot 0.6.1 computes them (`compute_stats.py`), of each episode and of all together.
//!
//! ```text
//! columns    numbers of the rows
//! sampling   which pictures and which of their pixels count
//! levels     pixels → statistics of each colour
//! ```

pub(crate) mod columns;
pub(crate) mod levels;
pub(crate) mod sampling;
