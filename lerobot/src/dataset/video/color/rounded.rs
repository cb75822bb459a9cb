//! 4:2:0 and 4:2:2 above 8 bits: luma and chroma are first rounded to 8 bits. Chroma is repeated horizontally and, in 4:2:0, interpolated
//! vertically.

use super::yuv::{Sampling, Yuv};

/// Chroma rows and weights in 1/4096.
type ChromaWeights = [(usize, i32); 4];

pub(super) fn convert(picture: &Yuv, [red, green, blue]: [&mut [u8]; 3]) -> Option<()> {
    let (width, colors) = (picture.width, picture.format.colors);
    let f = colors.factors();
    let relative = |factor: i64| ((factor * (1 << 16) + (1 << 15)) / f.luma) as i32;
    let [red_v, green_u, green_v, blue_u] = [f.red_v, f.green_u, f.green_v, f.blue_u].map(relative);
    let start = if colors.full_range { 384 } else { 326 };
    let (luma, base) = (f.luma as i32, -((384 + f.black as i32) << 16) + (1 << 15));
    let level = |brightness: i32| {
        let level = (base + (start + brightness) * luma) >> 16;
        level.clamp(0, 255) as u8
    };
    let (mut y, mut u, mut v) = (Vec::new(), Vec::new(), Vec::new());
    let mut samples = Vec::new();
    for row in 0..picture.height {
        picture.in_15_bits(picture.luma_row(row)?, &mut y);
        let weights = weights(picture, row);
        u.clear();
        u.resize(width.div_ceil(2), 1 << 18);
        v.clone_from(&u);
        for (chroma_row, weight) in weights {
            let (u_row, v_row) = picture.chroma_row(chroma_row)?;
            for (sums, row) in [(&mut u, u_row), (&mut v, v_row)] {
                picture.in_15_bits(row, &mut samples);
                for (sum, sample) in sums.iter_mut().zip(&samples) {
                    *sum += sample * weight;
                }
            }
        }
        let pairs = u.iter().zip(&v).enumerate();
        for (pair, (u, v)) in pairs {
            let (u, v) = ((u >> 19).clamp(0, 255), (v >> 19).clamp(0, 255));
            let (to_red, to_blue) = (part(v, red_v), part(u, blue_u));
            let to_green = part(u, green_u) + part(v, green_v);
            for x in pair * 2..(pair * 2 + 2).min(width) {
                let (at, y) = (row * width + x, (y[x] + (1 << 6)) >> 7);
                red[at] = level(y + to_red);
                green[at] = level(y + to_green);
                blue[at] = level(y + to_blue);
            }
        }
    }
    Some(())
}

fn part(chroma: i32, factor: i32) -> i32 {
    ((chroma * factor) >> 16) - (factor >> 9)
}

/// A row's chroma: a cubic filter in 4:2:0. swscale omits a row above rows 0 and 2.
fn weights(picture: &Yuv, row: usize) -> ChromaWeights {
    if picture.format.sampling != Sampling::Yuv420 {
        return [(row, 4096), (row, 0), (row, 0), (row, 0)];
    }
    let (rows, _) = picture.format.chroma_size(picture.height, picture.width);
    let at = |offset: isize| (row / 2).saturating_add_signed(offset).min(rows - 1);
    match row {
        0 => [(at(0), 4432), (at(1), -336), (0, 0), (0, 0)],
        2 => [(at(-1), 959), (at(0), 3473), (at(1), -336), (0, 0)],
        _ if row.is_multiple_of(2) => [(at(-2), -115), (at(-1), 985), (at(0), 3572), (at(1), -346)],
        _ => [(at(-1), -346), (at(0), 3572), (at(1), 985), (at(2), -115)],
    }
}
