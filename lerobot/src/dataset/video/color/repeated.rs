//! 4:2:0 and 4:2:2 with 8 bits: the arithmetic of swscale's vector instructions. Chroma is repeated, not interpolated.
//!
//! Values fit into 16 bits, and each loop does one thing to a whole row: the compiler vectorises it.

use super::matrix::in_13_bits;
use super::yuv::{Sampling, Yuv};

pub(super) fn convert(picture: &Yuv, [red, green, blue]: [&mut [u8]; 3]) -> Option<()> {
    let width = picture.width;
    let f = picture.format.colors.factors();
    let black = f.black as i16;
    let [luma, red_v, green_u, green_v, blue_u] =
        [f.luma, f.red_v, f.green_u, f.green_v, f.blue_u].map(|factor| in_13_bits(factor) as i16);
    let chroma_rows = match picture.format.sampling {
        Sampling::Yuv420 => 2,
        _ => 1,
    };
    let mut brightness = vec![0; width];
    let [mut to_red, mut to_green, mut to_blue] = [const { Vec::new() }; 3];
    for row in 0..picture.height {
        if row % chroma_rows == 0 {
            let (u, v) = picture.chroma_row(row / chroma_rows)?;
            twice(&mut to_red, u, v, |_, v| scaled(v, red_v));
            twice(&mut to_green, u, v, |u, v| {
                scaled(u, green_u) + scaled(v, green_v)
            });
            twice(&mut to_blue, u, v, |u, _| scaled(u, blue_u));
        }
        for (brightness, &y) in brightness.iter_mut().zip(picture.luma_row(row)?) {
            *brightness = scaled(i16::from(y) - black, luma);
        }
        let out = row * width..(row + 1) * width;
        levels(&mut red[out.clone()], &brightness, &to_red);
        levels(&mut green[out.clone()], &brightness, &to_green);
        levels(&mut blue[out], &brightness, &to_blue);
    }
    Some(())
}

/// Chroma's part in each of two pixels.
fn twice(parts: &mut Vec<[i16; 2]>, u: &[u8], v: &[u8], part: impl Fn(i16, i16) -> i16) {
    parts.resize(u.len(), [0; 2]);
    for ((pair, &u), &v) in parts.iter_mut().zip(u).zip(v) {
        *pair = [part(i16::from(u) - 128, i16::from(v) - 128); 2];
    }
}

fn scaled(x: i16, factor: i16) -> i16 {
    ((i32::from(8 * x) * i32::from(factor)) >> 16) as i16
}

fn levels(channel: &mut [u8], brightness: &[i16], parts: &[[i16; 2]]) {
    let parts = parts.as_flattened();
    for ((level, brightness), part) in channel.iter_mut().zip(brightness).zip(parts) {
        *level = (brightness + part).clamp(0, 255) as u8;
    }
}
