//! Quantiles of Student's t-distribution, in thousandths and rounded up.
//!
//! A quantile falls as the degrees of freedom grow. Between two rows of the table the upper row counts, so that a test never asks
//! for less than its confidence.

use borsh::{BorshDeserialize, BorshSerialize};
use core::fmt::{self, Display};
use core::str::FromStr;

/// How sure a one-sided test has to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, BorshSerialize, BorshDeserialize)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Confidence {
    /// 95 %.
    #[cfg_attr(feature = "serde", serde(rename = "95%"))]
    P95,
    /// 99 %.
    #[cfg_attr(feature = "serde", serde(rename = "99%"))]
    P99,
    /// 99.9 %.
    #[cfg_attr(feature = "serde", serde(rename = "99.9%"))]
    P999,
}

/// There is no such confidence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a confidence is 95%, 99% or 99.9%")]
pub struct UnknownConfidence;

impl FromStr for Confidence {
    type Err = UnknownConfidence;

    fn from_str(text: &str) -> Result<Self, UnknownConfidence> {
        match text {
            "95%" => Ok(Self::P95),
            "99%" => Ok(Self::P99),
            "99.9%" => Ok(Self::P999),
            _ => Err(UnknownConfidence),
        }
    }
}

impl Display for Confidence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::P95 => "95%",
            Self::P99 => "99%",
            Self::P999 => "99.9%",
        })
    }
}

/// Degrees of freedom, and the quantiles at 95 %, 99 % and 99.9 %.
const QUANTILES: [(u32, [u32; 3]); 40] = [
    (1, [6314, 31821, 318309]),
    (2, [2920, 6965, 22328]),
    (3, [2354, 4541, 10215]),
    (4, [2132, 3747, 7174]),
    (5, [2016, 3365, 5894]),
    (6, [1944, 3143, 5208]),
    (7, [1895, 2998, 4786]),
    (8, [1860, 2897, 4501]),
    (9, [1834, 2822, 4297]),
    (10, [1813, 2764, 4144]),
    (11, [1796, 2719, 4025]),
    (12, [1783, 2681, 3930]),
    (13, [1771, 2651, 3852]),
    (14, [1762, 2625, 3788]),
    (15, [1754, 2603, 3733]),
    (16, [1746, 2584, 3687]),
    (17, [1740, 2567, 3646]),
    (18, [1735, 2553, 3611]),
    (19, [1730, 2540, 3580]),
    (20, [1725, 2528, 3552]),
    (21, [1721, 2518, 3528]),
    (22, [1718, 2509, 3505]),
    (23, [1714, 2500, 3485]),
    (24, [1711, 2493, 3467]),
    (25, [1709, 2486, 3451]),
    (26, [1706, 2479, 3435]),
    (27, [1704, 2473, 3422]),
    (28, [1702, 2468, 3409]),
    (29, [1700, 2463, 3397]),
    (30, [1698, 2458, 3386]),
    (35, [1690, 2438, 3341]),
    (40, [1684, 2424, 3307]),
    (47, [1678, 2409, 3273]),
    (63, [1670, 2388, 3225]),
    (95, [1662, 2367, 3179]),
    (127, [1657, 2357, 3156]),
    (191, [1653, 2347, 3134]),
    (255, [1651, 2342, 3123]),
    (511, [1648, 2334, 3107]),
    (1023, [1647, 2330, 3099]),
];

/// The quantile for `samples` samples, which have `samples - 1` degrees of freedom. `None` for fewer than two samples, whose spread
/// nobody knows.
pub fn quantile(samples: u32, confidence: Confidence) -> Option<u32> {
    let freedom = samples.checked_sub(1)?;
    let row = QUANTILES
        .iter()
        .rev()
        .find(|(least, _)| *least <= freedom)?;
    Some(row.1[confidence as usize])
}
