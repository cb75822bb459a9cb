//! Counts of pictures, of which a stream holds the lowest bits (ITU-T H.264, 8.2.1.1, and H.265, 8.3.1).

/// The sequence, and the count of the picture before that others may refer to.
#[derive(Debug, Default)]
pub(super) struct PictureCount {
    sequence: u32,
    before: i64,
}

impl PictureCount {
    /// Begins a sequence.
    pub fn begin(&mut self) {
        self.sequence += 1;
        self.before = 0;
    }

    /// The sequence, and the whole count whose lowest `bits` bits are `low`: the nearest one to the picture before.
    pub fn whole(&self, low: u32, bits: u32) -> (u32, i64) {
        let all = 1i64 << bits;
        let (low, of_before) = (i64::from(low), self.before.rem_euclid(all));
        let high = self.before - of_before;
        let high = if of_before - low >= all / 2 {
            high + all
        } else if low - of_before > all / 2 {
            high - all
        } else {
            high
        };
        (self.sequence, high + low)
    }

    /// Notes the count of a picture that others may refer to.
    pub fn set(&mut self, count: i64) {
        self.before = count;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_go_on_where_their_bits_begin_anew() {
        let mut count = PictureCount::default();
        count.begin();
        for (low, whole) in [(0, 0), (6, 6), (4, 4), (12, 12), (2, 18), (15, 15), (3, 19)] {
            assert_eq!(count.whole(low, 4), (1, whole));
            count.set(whole);
        }
        count.begin();
        // Pictures that are shown before the key frame that they follow.
        assert_eq!(count.whole(14, 4), (2, -2));
    }
}
