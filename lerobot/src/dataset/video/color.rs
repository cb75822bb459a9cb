//! From decoded video to RGB, bit for bit as LeRobot's decoders do it.

/// An 8-bit 4:2:0 picture: luma `height x width`, chroma half of that (rounded up) each way, rows `stride` bytes apart.
#[derive(Debug, Clone, Copy)]
pub struct Yuv420<'a> {
    /// Luma.
    pub y: &'a [u8],
    /// Blue-difference chroma.
    pub u: &'a [u8],
    /// Red-difference chroma.
    pub v: &'a [u8],
    /// Bytes from one luma row to the next.
    pub y_stride: usize,
    /// Bytes from one chroma row to the next.
    pub uv_stride: usize,
    /// Pixels from top to bottom.
    pub height: usize,
    /// Pixels from left to right.
    pub width: usize,
}

/// RGB of a limited-range BT.601 picture, channel-first: `[3, height, width]`, or `None` where a plane is too short.
///
/// This is the integer arithmetic of FFmpeg's swscale, which torchcodec and PyAV both convert with; chroma is
/// repeated, not interpolated. The textbook formula differs from it by up to 3 levels.
pub fn rgb_from_yuv420(picture: &Yuv420) -> Option<Vec<u8>> {
    let Yuv420 { height, width, .. } = *picture;
    let plane = height.checked_mul(width)?;
    let mut rgb = vec![0; plane.checked_mul(3)?];
    let (red, rest) = rgb.split_at_mut(plane);
    let (green, blue) = rest.split_at_mut(plane);
    for row in 0..height {
        let y = picture.y.get(row * picture.y_stride..)?.get(..width)?;
        let half = width.div_ceil(2);
        let chroma_row = row / 2 * picture.uv_stride;
        let u = picture.u.get(chroma_row..)?.get(..half)?;
        let v = picture.v.get(chroma_row..)?.get(..half)?;
        let out = row * width..(row + 1) * width;
        let (r, g, b) = (
            &mut red[out.clone()],
            &mut green[out.clone()],
            &mut blue[out],
        );
        for (pair, (&u, &v)) in u.iter().zip(v).enumerate() {
            let (du, dv) = (i32::from(u) - 128, i32::from(v) - 128);
            let (to_red, to_blue) = (scaled(dv, 13075), scaled(du, 16525));
            let to_green = scaled(du, -3209) + scaled(dv, -6660);
            for x in pair * 2..(pair * 2 + 2).min(width) {
                let luma = scaled(i32::from(y[x]) - 16, 9539);
                r[x] = level(luma + to_red);
                g[x] = level(luma + to_green);
                b[x] = level(luma + to_blue);
            }
        }
    }
    Some(rgb)
}

fn scaled(x: i32, c: i32) -> i32 {
    (8 * x * c) >> 16
}

fn level(x: i32) -> u8 {
    x.clamp(0, 255) as u8
}
