//! 4:2:0 and 4:2:2 with 8 bits: the arithmetic of swscale's vector instructions; chroma is repeated, not interpolated.

use super::matrix::in_13_bits;
use super::yuv::{Sampling, Yuv};

pub(super) fn convert(picture: &Yuv, [red, green, blue]: [&mut [u8]; 3]) -> Option<()> {
    let width = picture.width;
    let f = picture.format.colors.factors();
    let black = f.black as i32;
    let [luma, red_v, green_u, green_v, blue_u] =
        [f.luma, f.red_v, f.green_u, f.green_v, f.blue_u].map(in_13_bits);
    let chroma_rows = match picture.format.sampling {
        Sampling::Yuv420 => 2,
        _ => 1,
    };
    for row in 0..picture.height {
        let y = picture.luma_row(row)?;
        let (u, v) = picture.chroma_row(row / chroma_rows)?;
        let out = row * width..(row + 1) * width;
        let (r, g, b) = (
            &mut red[out.clone()],
            &mut green[out.clone()],
            &mut blue[out],
        );
        for (pair, (&u, &v)) in u.iter().zip(v).enumerate() {
            let (du, dv) = (i32::from(u) - 128, i32::from(v) - 128);
            let (to_red, to_blue) = (scaled(dv, red_v), scaled(du, blue_u));
            let to_green = scaled(du, green_u) + scaled(dv, green_v);
            for x in pair * 2..(pair * 2 + 2).min(width) {
                let luma = scaled(i32::from(y[x]) - black, luma);
                r[x] = level(luma + to_red);
                g[x] = level(luma + to_green);
                b[x] = level(luma + to_blue);
            }
        }
    }
    Some(())
}

fn scaled(x: i32, c: i32) -> i32 {
    (8 * x * c) >> 16
}

fn level(x: i32) -> u8 {
    x.clamp(0, 255) as u8
}
