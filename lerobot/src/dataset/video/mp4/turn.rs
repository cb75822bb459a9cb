//! How a picture is turned: the matrices of `mvhd` and `tkhd` (ISO/IEC 14496-12, 8.2.2 and 8.3.2).

use super::boxes::{Fields, Result};

/// A clockwise turn by quarters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rotation {
    /// As stored.
    None,
    /// By 90 degrees.
    Right,
    /// By 180 degrees.
    Over,
    /// By 270 degrees.
    Left,
}

const ONE: i32 = 1 << 16;
const QUARTERS: [([i32; 4], Rotation); 5] = [
    ([ONE, 0, 0, ONE], Rotation::None),
    // Some writers omit the matrix.
    ([0; 4], Rotation::None),
    ([0, ONE, -ONE, 0], Rotation::Right),
    ([-ONE, 0, 0, -ONE], Rotation::Over),
    ([0, -ONE, ONE, 0], Rotation::Left),
];

impl Rotation {
    /// The turn of a track header's matrix.
    pub(crate) fn of_track(header: &[u8]) -> Result<Self> {
        // 4 bytes of version and flags; times take 20 bytes, in version 1 32; reserved fields, layer, group and volume 16.
        let matrix = matrix(header, [4 + 20, 4 + 32], 16)?;
        QUARTERS
            .iter()
            .find(|(quarter, _)| *quarter == matrix)
            .map(|(_, turn)| *turn)
            .ok_or_else(|| {
                let [a, b, c, d] = matrix.map(|x| f64::from(x) / f64::from(ONE));
                format!(
                    "is shown through a matrix of {a} {b} {c} {d} (tkhd), and only turns by quarters are read; re-encode the video"
                )
            })
    }

    /// Refuses a turn of the whole movie.
    pub(crate) fn refuse_in_movie(header: &[u8]) -> Result<()> {
        // Times take 16 bytes, in version 1 28; rate, volume and reserved fields 16.
        match matrix(header, [4 + 16, 4 + 28], 16)? {
            [ONE, 0, 0, ONE] | [0, 0, 0, 0] => Ok(()),
            _ => Err("turns the whole movie (mvhd), which is not read; re-encode the video".into()),
        }
    }

    pub(crate) fn size(self, height: usize, width: usize) -> (usize, usize) {
        match self {
            Self::None | Self::Over => (height, width),
            Self::Right | Self::Left => (width, height),
        }
    }

    /// Turns a picture `[3, height, width]`.
    pub(crate) fn apply(self, rgb: Vec<u8>, height: usize, width: usize) -> Vec<u8> {
        if self == Self::None {
            return rgb;
        }
        let (rows, columns) = self.size(height, width);
        let mut turned = Vec::with_capacity(rgb.len());
        for channel in rgb.chunks_exact((height * width).max(1)) {
            for row in 0..rows {
                turned.extend((0..columns).map(|column| {
                    let (y, x) = match self {
                        Self::None => (row, column),
                        Self::Right => (height - 1 - column, row),
                        Self::Over => (height - 1 - row, width - 1 - column),
                        Self::Left => (column, width - 1 - row),
                    };
                    channel[y * width + x]
                }));
            }
        }
        turned
    }
}

/// A matrix's rows (a, b) and (c, d), which turn and stretch, in 1/65536.
fn matrix(header: &[u8], times: [usize; 2], between: usize) -> Result<[i32; 4]> {
    let wide = Fields(header).u8()? == 1;
    let mut fields = Fields(header).skip(times[usize::from(wide)] + between)?;
    let (a, b, _, c, d) = (
        fields.u32()?,
        fields.u32()?,
        fields.u32()?,
        fields.u32()?,
        fields.u32()?,
    );
    Ok([a, b, c, d].map(|x| x as i32))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarters_turn_clockwise() {
        let rgb = vec![
            1, 2, 3, 4, 5, 6, 11, 12, 13, 14, 15, 16, 21, 22, 23, 24, 25, 26,
        ];
        let first = |turn: Rotation| turn.apply(rgb.clone(), 2, 3)[..6].to_vec();
        assert_eq!(first(Rotation::None), [1, 2, 3, 4, 5, 6]);
        assert_eq!(first(Rotation::Right), [4, 1, 5, 2, 6, 3]);
        assert_eq!(first(Rotation::Over), [6, 5, 4, 3, 2, 1]);
        assert_eq!(first(Rotation::Left), [3, 6, 2, 5, 1, 4]);
        let around = Rotation::Left.apply(Rotation::Right.apply(rgb.clone(), 2, 3), 3, 2);
        assert_eq!(around, rgb);
    }
}
