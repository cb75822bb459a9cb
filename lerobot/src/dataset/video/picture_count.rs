//! Picture counts, of which streams hold the lowest bits (ITU-T H.264, 8.2.1.1, and H.265, 8.3.1).

/// The sequence, and the count of the last reference picture.
#[derive(Debug, Default)]
pub(super) struct PictureCount {
    sequence: u32,
    before: i64,
}

impl PictureCount {
    pub fn begin(&mut self) {
        self.sequence += 1;
        self.before = 0;
    }

    /// The sequence, and the count nearest to the last reference picture's whose lowest `bits` bits are `low`.
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
        // Pictures shown before their key frame.
        assert_eq!(count.whole(14, 4), (2, -2));
    }
}
