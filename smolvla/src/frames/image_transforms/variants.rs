//! Transformed variants of training frames.

use std::ops::RangeInclusive;

use rand::SeedableRng;
use rand_chacha::ChaCha20Rng;
use sha2::{Digest, Sha256};
use zk0_lerobot::dataset::Image;

use crate::error::{PolicyError, Result};
use crate::frames::image_transforms::config::ImageTransformsConfig;
use crate::frames::image_transforms::drawing::Sampler;
use crate::frames::image_transforms::picture::Picture;
use crate::frames::prefix_cache::key::{CacheKey, FrameRef};

/// The allowed numbers of variants.
pub const COUNTS: RangeInclusive<usize> = 1..=1000;

/// Makes transformed variants of each frame.
///
/// A variant's name in the prefix cache is a digest of the frame's name, the transforms, the seed and the variant's number. It also seeds
/// the drawing.
#[derive(Clone, Debug)]
pub struct Variants {
    sampler: Sampler,
    of: [u8; 32],
    count: usize,
}

impl Variants {
    /// `count` variants of each frame; `None` if `config` transforms nothing.
    ///
    /// # Errors
    /// [`PolicyError::Options`]: the count is outside 1 to 1000, or `config` is not usable.
    pub fn new(config: &ImageTransformsConfig, count: usize, seed: u64) -> Result<Option<Self>> {
        if !COUNTS.contains(&count) {
            return Err(PolicyError::Options(format!(
                "{count} image variants are asked for; there may be {} to {}",
                COUNTS.start(),
                COUNTS.end()
            )));
        }
        let Some(sampler) = config.sampler()? else {
            return Ok(None);
        };
        let mut hash = Sha256::new();
        hash.update(b"zk0:image-transforms:v1\0");
        hash.update(seed.to_le_bytes());
        // The derived `Debug` names every field.
        hash.update(format!("{sampler:?}"));
        Ok(Some(Self {
            sampler,
            of: hash.finalize().into(),
            count,
        }))
    }

    /// All variants of `frames`.
    pub fn frames(&self, frames: &[FrameRef]) -> Vec<FrameRef> {
        let variant = |frame: &FrameRef, number: usize| {
            let mut hash = Sha256::new();
            hash.update(b"zk0:image-variant:v1\0");
            hash.update(self.of);
            hash.update(frame.key.0);
            hash.update((number as u64).to_le_bytes());
            FrameRef {
                key: CacheKey(hash.finalize().into()),
                transformed: true,
                ..*frame
            }
        };
        let of_frame = |frame| (0..self.count).map(move |number| variant(frame, number));
        frames.iter().flat_map(of_frame).collect()
    }

    /// A variant's pictures, transformed one by one as in LeRobot.
    pub(crate) fn pictures(&self, variant: &CacheKey, images: &[Image]) -> Vec<Picture> {
        let mut rng = ChaCha20Rng::from_seed(variant.0);
        images
            .iter()
            .map(|image| {
                let mut picture = Picture::of_bytes(image.height, image.width, &image.pixels);
                let size = (image.height, image.width);
                for transform in self.sampler.draw(size, &mut rng) {
                    transform.apply(&mut picture);
                }
                picture
            })
            .collect()
    }
}
