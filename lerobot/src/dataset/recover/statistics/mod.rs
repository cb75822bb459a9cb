//! Statistics of an episode as LeRobot 0.6.1 computes them (`compute_stats.py`), and those of all episodes together.
//!
//! ```text
//! columns    numbers of the rows
//! sampling   which pictures of an episode count, and which of their pixels
//! levels     pixels → statistics of each colour
//! ```

pub(crate) mod columns;
pub(crate) mod levels;
pub(crate) mod sampling;
