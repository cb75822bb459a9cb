//! Colours and legends.

use plotters::coord::Shift;
use plotters::prelude::*;

/// The result of drawing on a backend.
pub type DrawResult<B, T = ()> = Result<T, DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

/// Eight colours for people with any kind of colour vision (Okabe and Ito, Color Universal Design, 2008).
pub struct PaletteForAll;

impl Palette for PaletteForAll {
    const COLORS: &'static [(u8, u8, u8)] = &[
        (0, 114, 178),
        (213, 94, 0),
        (0, 158, 115),
        (204, 121, 167),
        (230, 159, 0),
        (86, 180, 233),
        (240, 228, 66),
        (0, 0, 0),
    ];
}

/// The colour of background curves.
pub const GREY: RGBColor = RGBColor(150, 150, 150);

/// A colour's name in the legend.
pub struct LegendEntry {
    /// The name.
    pub name: String,
    /// The colour.
    pub colour: RGBAColor,
}

/// Pixels between names.
const LINE: i32 = 18;
/// Pixels above the first name.
const ABOVE: i32 = 44;
/// Pixels of a line, and beside it.
const SAMPLE: i32 = 18;
const GAP: i32 = 6;

/// Writes the names on the right, counts those without room, and returns the rest of `area`.
pub fn beside<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    keys: &[LegendEntry],
) -> DrawResult<B, DrawingArea<B, Shift>> {
    let font = ("sans-serif", 13).into_text_style(area);
    let (width, height) = area.dim_in_pixel();
    let mut widest = 0;
    for key in keys {
        widest = widest.max(area.estimate_text_size(&key.name, &font)?.0 as i32);
    }
    let names = (widest + SAMPLE + 3 * GAP).min(width as i32 / 2);
    let (left, right) = area.split_horizontally(width as i32 - names);
    let room = ((height as i32 - ABOVE) / LINE).max(1) as usize;
    let shown = if keys.len() > room {
        room - 1
    } else {
        keys.len()
    };
    let place = |number: usize| ABOVE + LINE * number as i32;
    for (number, key) in keys[..shown].iter().enumerate() {
        let middle = place(number) + LINE / 2 - 2;
        let sample = [(0, middle), (SAMPLE, middle)];
        right.draw(&PathElement::new(sample, key.colour.stroke_width(3)))?;
        right.draw(&Text::new(
            key.name.clone(),
            (SAMPLE + GAP, place(number)),
            font.clone(),
        ))?;
    }
    if shown < keys.len() {
        let more = format!("and {} more", keys.len() - shown);
        right.draw(&Text::new(more, (SAMPLE + GAP, place(shown)), font.clone()))?;
    }
    Ok(left)
}
