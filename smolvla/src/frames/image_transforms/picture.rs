//! A picture as numbers.

/// A picture as LeRobot transforms it.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels from top to bottom.
    pub height: usize,
    /// Pixels from left to right.
    pub width: usize,
    /// RGB (3, height, width), between 0 and 1.
    pub values: Vec<f32>,
}

impl Picture {
    /// From 8-bit RGB (3, height, width).
    pub fn of_bytes(height: usize, width: usize, pixels: &[u8]) -> Self {
        Self {
            height,
            width,
            values: pixels.iter().map(|p| f32::from(*p) / 255.0).collect(),
        }
    }

    pub(super) fn area(&self) -> usize {
        self.height * self.width
    }

    pub(super) fn rgb(&self, at: usize) -> [f32; 3] {
        [0, 1, 2].map(|plane| self.values[plane * self.area() + at])
    }

    pub(super) fn map(&mut self, change: impl Fn([f32; 3]) -> [f32; 3]) {
        let area = self.area();
        for at in 0..area {
            let changed = change(self.rgb(at));
            for (plane, value) in changed.into_iter().enumerate() {
                self.values[plane * area + at] = value;
            }
        }
    }
}
