//! Which pictures and which of their pixels LeRobot's statistics count.

/// Up to so many pictures, all count.
const FEW: usize = 100;
/// More never count.
const MOST: usize = 10_000;
/// A picture whose longer side is shorter counts whole.
const SMALL: usize = 300;
/// Other pictures' longer side is reduced to between this and twice as many pixels.
const TARGET: usize = 150;

/// Which pictures count, of an episode of `frames`.
pub(crate) fn sampled_frames(frames: usize) -> Vec<usize> {
    let growing = (frames as f64).powf(0.75) as usize;
    let count = growing.min(MOST).max(FEW.min(frames));
    if count < 2 {
        return vec![0; count];
    }
    let step = (frames - 1) as f64 / (count - 1) as f64;
    let at = |i| (i as f64 * step).round_ties_even() as usize;
    let mut sampled: Vec<usize> = (0..count - 1).map(at).collect();
    sampled.push(frames - 1);
    sampled
}

/// Every how many-th row and column counts.
pub(crate) fn pixel_step(height: usize, width: usize) -> usize {
    match height.max(width) {
        small if small < SMALL => 1,
        longer => longer / TARGET,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From LeRobot 0.6.1's `sample_indices`.
    #[test]
    fn pictures_are_sampled_as_lerobot_does() {
        for frames in [1, 2, 7, 100] {
            let all: Vec<usize> = (0..frames).collect();
            assert_eq!(sampled_frames(frames), all);
        }
        let of = |frames| {
            let sampled = sampled_frames(frames);
            let sum: usize = sampled.iter().sum();
            (sampled.len(), sum, sampled[1], sampled[sampled.len() / 2])
        };
        let found = [101, 464, 465, 1000, 12_345, 300_000].map(of);
        let given = [
            (100, 5_000, 1, 51),
            (100, 23_150, 5, 234),
            (100, 23_200, 5, 234),
            (177, 88_412, 6, 500),
            (1171, 7_227_412, 11, 6172),
            (10_000, 1_499_995_000, 30, 150_015),
        ];
        assert_eq!(found, given);
    }

    /// From LeRobot 0.6.1's `auto_downsample_height_width`.
    #[test]
    fn large_pictures_count_with_some_of_their_pixels() {
        let steps = [
            (299, 64),
            (300, 64),
            (64, 449),
            (480, 640),
            (640, 480),
            (1080, 1920),
        ];
        let found = steps.map(|(height, width)| pixel_step(height, width));
        assert_eq!(found, [1, 2, 2, 4, 4, 12]);
    }
}
