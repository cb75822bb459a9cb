//! One transform with its parameters.

use crate::frames::image_transforms::affine::AffineTransform;
use crate::frames::image_transforms::color;
use crate::frames::image_transforms::picture::Picture;

/// A transform with the parameters of torchvision's function.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Transform {
    /// `adjust_brightness`: 1 changes nothing, 0 gives black.
    Brightness(f32),
    /// `adjust_contrast`: 1 changes nothing, 0 gives the mean grey.
    Contrast(f32),
    /// `adjust_saturation`: 1 changes nothing, 0 gives shades of grey.
    Saturation(f32),
    /// `adjust_hue`: the share of a turn of the colour circle, from -0.5 to 0.5.
    Hue(f32),
    /// `adjust_sharpness`: 1 changes nothing, 0 gives a blurred picture.
    Sharpness(f32),
    /// `affine`, with the nearest pixel, and black outside the picture.
    Affine(AffineTransform),
}

impl Transform {
    /// Changes a picture.
    pub fn apply(&self, picture: &mut Picture) {
        match self {
            Self::Brightness(factor) => color::brightness(picture, *factor),
            Self::Contrast(factor) => color::contrast(picture, *factor),
            Self::Saturation(factor) => color::saturation(picture, *factor),
            Self::Hue(turn) => color::hue(picture, *turn),
            Self::Sharpness(factor) => color::sharpness(picture, *factor),
            Self::Affine(affine) => affine.apply(picture),
        }
    }
}
