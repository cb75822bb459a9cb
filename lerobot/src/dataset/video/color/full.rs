//! 4:4:4: every pixel has its own chroma, rounded once.

use super::matrix::in_13_bits;
use super::yuv::Yuv;

pub(super) fn convert(picture: &Yuv, [red, green, blue]: [&mut [u8]; 3]) -> Option<()> {
    let width = picture.width;
    let f = picture.format.colors.factors();
    let black = (f.black as i32) << 9;
    let [luma, red_v, green_u, green_v, blue_u] =
        [f.luma, f.red_v, f.green_u, f.green_v, f.blue_u].map(in_13_bits);
    let [mut y, mut u, mut v] = [const { Vec::new() }; 3];
    for row in 0..picture.height {
        let (u_row, v_row) = picture.chroma_row(row)?;
        picture.in_15_bits(picture.luma_row(row)?, &mut y);
        picture.in_15_bits(u_row, &mut u);
        picture.in_15_bits(v_row, &mut v);
        for x in 0..width {
            let luma = (y[x] * 4 - black) * luma + (1 << 21);
            let (u, v) = ((u[x] - (128 << 7)) * 4, (v[x] - (128 << 7)) * 4);
            let at = row * width + x;
            red[at] = level(luma, v * red_v);
            green[at] = level(luma, v * green_v + u * green_u);
            blue[at] = level(luma, u * blue_u);
        }
    }
    Some(())
}

/// Overflows as in swscale: white with the strongest blue becomes black.
fn level(luma: i32, chroma: i32) -> u8 {
    (luma.wrapping_add(chroma).clamp(0, (1 << 30) - 1) >> 22) as u8
}
