//! Transforms of a picture and their parameters, from a seed. The distributions are those of LeRobot's `RandomSubsetApply` and
//! torchvision's classes; the random numbers are not PyTorch's.

use rand_chacha::ChaCha20Rng;

use crate::frames::image_transforms::affine::AffineTransform;
use crate::frames::image_transforms::transform::Transform;
use crate::policy::random::{index, uniform};

/// Bounds of a uniform parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UniformRange {
    /// The lower bound.
    pub low: f64,
    /// The upper bound.
    pub high: f64,
}

impl UniformRange {
    fn draw(self, rng: &mut ChaCha20Rng) -> f64 {
        self.low + (self.high - self.low) * uniform(rng)
    }
}

/// A transform with random parameters.
#[derive(Clone, Debug, PartialEq)]
pub enum Jitter {
    /// Changes nothing.
    Identity,
    /// torchvision's `ColorJitter`.
    Color {
        /// The factor's bounds.
        brightness: Option<UniformRange>,
        /// The factor's bounds.
        contrast: Option<UniformRange>,
        /// The factor's bounds.
        saturation: Option<UniformRange>,
        /// Bounds of the share of a turn.
        hue: Option<UniformRange>,
    },
    /// LeRobot's `SharpnessJitter`.
    Sharpness(UniformRange),
    /// torchvision's `RandomAffine`.
    Affine {
        /// The angle's bounds.
        degrees: UniformRange,
        /// The largest shift either way, as shares of width and height.
        translate: Option<[f64; 2]>,
        /// The scale's bounds.
        scale: Option<UniformRange>,
        /// Bounds of the shear along x and y, in degrees.
        shear: [Option<UniformRange>; 2],
    },
}

/// Draws transforms.
#[derive(Clone, Debug, PartialEq)]
pub struct Sampler {
    /// The transforms, each with its weight above 0.
    pub choices: Vec<(f64, Jitter)>,
    /// How many are chosen; all at most.
    pub count: usize,
    /// In drawn order, not that of [`Self::choices`].
    pub random_order: bool,
}

impl Sampler {
    /// Draws a picture's transforms.
    pub fn draw(&self, (height, width): (usize, usize), rng: &mut ChaCha20Rng) -> Vec<Transform> {
        let mut left: Vec<usize> = (0..self.choices.len()).collect();
        let mut chosen = Vec::with_capacity(self.count);
        while chosen.len() < self.count && !left.is_empty() {
            let total: f64 = left.iter().map(|choice| self.choices[*choice].0).sum();
            let mut point = total * uniform(rng);
            let past = |choice: &usize| {
                point -= self.choices[*choice].0;
                point < 0.0
            };
            let place = left.iter().position(past).unwrap_or(left.len() - 1);
            chosen.push(left.remove(place));
        }
        if !self.random_order {
            chosen.sort_unstable();
        }
        let mut transforms = Vec::new();
        for choice in chosen {
            self.choices[choice]
                .1
                .draw(height, width, rng, &mut transforms);
        }
        transforms
    }
}

impl Jitter {
    fn draw(&self, height: usize, width: usize, rng: &mut ChaCha20Rng, to: &mut Vec<Transform>) {
        match self {
            Self::Identity => {}
            Self::Color {
                brightness,
                contrast,
                saturation,
                hue,
            } => {
                let mut parts: Vec<(UniformRange, fn(f32) -> Transform)> = [
                    (brightness, Transform::Brightness as fn(f32) -> Transform),
                    (contrast, Transform::Contrast),
                    (saturation, Transform::Saturation),
                    (hue, Transform::Hue),
                ]
                .into_iter()
                .filter_map(|(range, of)| Some(((*range)?, of)))
                .collect();
                // As in torchvision, in random order.
                while !parts.is_empty() {
                    let (range, of) = parts.remove(index(rng, parts.len()));
                    to.push(of(range.draw(rng) as f32));
                }
            }
            Self::Sharpness(range) => to.push(Transform::Sharpness(range.draw(rng) as f32)),
            Self::Affine {
                degrees,
                translate,
                scale,
                shear,
            } => {
                let angle = degrees.draw(rng);
                let mut shift = |share: f64, length: usize| {
                    let high = share * length as f64;
                    UniformRange { low: -high, high }
                        .draw(rng)
                        .round_ties_even()
                };
                let translate =
                    translate.map_or([0.0; 2], |[x, y]| [shift(x, width), shift(y, height)]);
                let scale = scale.map_or(1.0, |range| range.draw(rng));
                let shear = shear.map(|range| range.map_or(0.0, |range| range.draw(rng)));
                to.push(Transform::Affine(AffineTransform {
                    angle,
                    translate,
                    scale,
                    shear,
                }));
            }
        }
    }
}
