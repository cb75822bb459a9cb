//! Changes of colour and sharpness, as in torchvision's `v2.functional` on floating-point pictures.

use crate::frames::image_transforms::picture::Picture;

pub(super) fn brightness(picture: &mut Picture, factor: f32) {
    picture
        .values
        .iter_mut()
        .for_each(|value| *value = (*value * factor).clamp(0.0, 1.0));
}

pub(super) fn contrast(picture: &mut Picture, factor: f32) {
    let area = picture.area();
    let sum: f64 = (0..area).map(|at| f64::from(grey(picture.rgb(at)))).sum();
    let mean = (sum / area as f64) as f32;
    picture
        .values
        .iter_mut()
        .for_each(|value| *value = blend(*value, mean, factor));
}

pub(super) fn saturation(picture: &mut Picture, factor: f32) {
    picture.map(|rgb| {
        let grey = grey(rgb);
        rgb.map(|value| blend(value, grey, factor))
    });
}

pub(super) fn hue(picture: &mut Picture, turn: f32) {
    picture.map(|rgb| {
        let (h, s, v) = hsv(rgb);
        rgb_of((h + turn).rem_euclid(1.0), s, v)
    });
}

pub(super) fn sharpness(picture: &mut Picture, factor: f32) {
    let (height, width) = (picture.height, picture.width);
    if height <= 2 || width <= 2 {
        return;
    }
    let (beside, centre) = (1.0 / 13.0, 5.0 / 13.0);
    let mut sharp = picture.values.clone();
    let planes = picture.values.chunks_exact(height * width);
    for (plane, out) in planes.zip(sharp.chunks_exact_mut(height * width)) {
        for y in 1..height - 1 {
            for x in 1..width - 1 {
                let mut blurred = 0.0;
                for row in y - 1..=y + 1 {
                    for column in x - 1..=x + 1 {
                        let weight = if (row, column) == (y, x) {
                            centre
                        } else {
                            beside
                        };
                        blurred += weight * plane[row * width + column];
                    }
                }
                let at = y * width + x;
                out[at] = plane[at] + (blurred - plane[at]) * (1.0 - factor);
            }
        }
    }
    sharp
        .iter_mut()
        .for_each(|value| *value = value.clamp(0.0, 1.0));
    picture.values = sharp;
}

fn blend(value: f32, other: f32, ratio: f32) -> f32 {
    (value * ratio + other * (1.0 - ratio)).clamp(0.0, 1.0)
}

fn grey([r, g, b]: [f32; 3]) -> f32 {
    r * 0.2989 + g * 0.587 + b * 0.114
}

/// Hue, saturation and value, from 0 to 1.
fn hsv([r, g, b]: [f32; 3]) -> (f32, f32, f32) {
    let (most, least) = (r.max(g).max(b), r.min(g).min(b));
    if most == least {
        return (0.0, 0.0, most);
    }
    let range = most - least;
    let [rc, gc, bc] = [r, g, b].map(|value| (most - value) / range);
    let sixths = if most == r {
        bc - gc
    } else if most == g {
        rc + 2.0 - bc
    } else {
        gc + 4.0 - rc
    };
    ((sixths * (1.0 / 6.0) + 1.0) % 1.0, range / most, most)
}

fn rgb_of(h: f32, s: f32, v: f32) -> [f32; 3] {
    let sixths = h * 6.0;
    let sector = sixths.floor();
    let within = sixths - sector;
    let unit = |value: f32| value.clamp(0.0, 1.0);
    let p = unit((1.0 - s) * v);
    let q = unit((1.0 - s * within) * v);
    let t = unit((s * within + (1.0 - s)) * v);
    match sector as i32 {
        1 => [q, v, p],
        2 => [p, v, t],
        3 => [p, q, v],
        4 => [t, p, v],
        5 => [v, p, q],
        _ => [v, t, p],
    }
}
