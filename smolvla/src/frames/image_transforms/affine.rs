//! Rotation, translation, scale and shear, as in torchvision's `v2.functional.affine`.

use crate::frames::image_transforms::picture::Picture;

/// Rotates around the centre, then moves, scales and shears.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AffineTransform {
    /// Clockwise, in degrees.
    pub angle: f64,
    /// To the right and down, in pixels.
    pub translate: [f64; 2],
    /// Above 0; 1 keeps the size.
    pub scale: f64,
    /// Along x and y, in degrees.
    pub shear: [f64; 2],
}

impl AffineTransform {
    /// A pixel's origin: rows for (x, y, 1), from the centre.
    fn inverse(&self) -> [[f64; 3]; 2] {
        let (angle, [shear_x, shear_y]) = (
            self.angle.to_radians(),
            self.shear.map(|degrees| degrees.to_radians()),
        );
        let turn = angle - shear_y;
        let a = turn.cos() / shear_y.cos();
        let b = -(a * shear_x.tan() + angle.sin());
        let c = turn.sin() / shear_y.cos();
        let d = angle.cos() - c * shear_x.tan();
        let [x, y] = self.translate;
        // Rotation and shear have determinant 1.
        [[d, -b], [-c, a]].map(|[along_x, along_y]| {
            let (along_x, along_y) = (along_x / self.scale, along_y / self.scale);
            [along_x, along_y, -along_x * x - along_y * y]
        })
    }

    pub(super) fn apply(&self, picture: &mut Picture) {
        let (height, width) = (picture.height, picture.width);
        let matrix = self.inverse().map(|row| row.map(|value| value as f32));
        // In float32 and PyTorch's order: rounding decides the nearest pixel.
        let halves = [0.5 * width as f32, 0.5 * height as f32];
        let scaled = |axis: usize| matrix[axis].map(|value| value / halves[axis]);
        let rows = [scaled(0), scaled(1)];
        let nearest = |axis: usize, x: f32, y: f32, length: usize| -> Option<usize> {
            let [along_x, along_y, shift] = rows[axis];
            let normalised = x * along_x + y * along_y + shift;
            let place = ((normalised + 1.0) * length as f32 - 1.0) / 2.0;
            let place = place.round_ties_even();
            (place >= 0.0 && place < length as f32).then_some(place as usize)
        };
        let first = |length: usize| (1.0 - length as f32) * 0.5;
        let mut moved = vec![0.0; picture.values.len()];
        for row in 0..height {
            let y = first(height) + row as f32;
            for column in 0..width {
                let x = first(width) + column as f32;
                let source = nearest(0, x, y, width).zip(nearest(1, x, y, height));
                let Some((from_x, from_y)) = source else {
                    continue;
                };
                for plane in 0..3 {
                    let plane = plane * height * width;
                    moved[plane + row * width + column] =
                        picture.values[plane + from_y * width + from_x];
                }
            }
        }
        picture.values = moved;
    }
}
