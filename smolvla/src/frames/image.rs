//! Resizes camera frames, as LeRobot's `resize_with_pad`.

/// Resizes planes (channels, height, width) to fit into `size` (height, width) with the same aspect, by bilinear interpolation (no
/// antialiasing, corners not aligned). Fills the rest **above and to the left** with 0.
///
/// `planes` holds whole planes of `height * width`, both at least 1.
pub fn resize_with_pad(
    planes: &[f32],
    (height, width): (usize, usize),
    size: (usize, usize),
) -> Vec<f32> {
    let (out_height, out_width) = size;
    // In f64, truncated, as in LeRobot's Python.
    let ratio = (width as f64 / out_width as f64).max(height as f64 / out_height as f64);
    let scaled = |length: usize, limit: usize| ((length as f64 / ratio) as usize).clamp(1, limit);
    let (rows, columns) = (scaled(height, out_height), scaled(width, out_width));
    let (top, left) = (out_height - rows, out_width - columns);
    let (ys, xs) = (taps(height, rows), taps(width, columns));

    let mut out = vec![0.0; planes.len() / (height * width) * out_height * out_width];
    let sources = planes.chunks_exact(height * width);
    for (source, target) in sources.zip(out.chunks_exact_mut(out_height * out_width)) {
        for (row, y) in ys.iter().enumerate() {
            let line = &mut target[(top + row) * out_width + left..][..columns];
            for (pixel, x) in line.iter_mut().zip(&xs) {
                let at = |row: usize, column: usize| source[row * width + column];
                let upper =
                    at(y.first, x.first) * (1.0 - x.weight) + at(y.first, x.second) * x.weight;
                let lower =
                    at(y.second, x.first) * (1.0 - x.weight) + at(y.second, x.second) * x.weight;
                *pixel = upper * (1.0 - y.weight) + lower * y.weight;
            }
        }
    }
    out
}

/// An 8-bit RGB picture (3, height, width) as (3, size, size) in [-1, 1], padding at -1.
pub fn vision_input(pixels: &[u8], shape: (usize, usize), size: usize) -> Vec<f32> {
    let unit: Vec<f32> = pixels.iter().map(|p| f32::from(*p) / 255.0).collect();
    unit_vision_input(&unit, shape, size)
}

/// As [`vision_input`], for values between 0 and 1.
pub fn unit_vision_input(unit: &[f32], shape: (usize, usize), size: usize) -> Vec<f32> {
    let mut resized = resize_with_pad(unit, shape, (size, size));
    resized.iter_mut().for_each(|x| *x = 2.0 * *x - 1.0);
    resized
}

/// An output pixel's two input neighbours along one axis.
struct Tap {
    first: usize,
    second: usize,
    /// The second's share.
    weight: f32,
}

fn taps(length: usize, out: usize) -> Vec<Tap> {
    let scale = length as f32 / out as f32;
    (0..out)
        .map(|i| {
            let position = (scale * (i as f32 + 0.5) - 0.5).max(0.0);
            let first = (position as usize).min(length - 1);
            Tap {
                first,
                second: (first + 1).min(length - 1),
                weight: position - first as f32,
            }
        })
        .collect()
}
