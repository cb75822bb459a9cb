//! Colours, and the names of what has them, which stand beside a chart and not on it.

use plotters::coord::Shift;
use plotters::prelude::*;

/// What drawing on a backend gives.
pub type DrawResult<B, T = ()> = Result<T, DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

/// Eight colours that people with any kind of colour vision can tell apart (Okabe and Ito, Color Universal Design, 2008).
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

/// The colour of what stands behind the rest.
pub const GREY: RGBColor = RGBColor(150, 150, 150);

/// The name of what is drawn in a colour.
pub struct LegendEntry {
    /// The name.
    pub name: String,
    /// The colour.
    pub colour: RGBAColor,
}

/// Pixels from one name to the next.
const LINE: i32 = 18;
/// Pixels above the first name: as many as a caption takes.
const ABOVE: i32 = 44;
/// Pixels of the line in the colour, and of the gaps beside it.
const SAMPLE: i32 = 18;
const GAP: i32 = 6;

/// Writes the names right of what is left of `area`, which it returns. Names that have no room are counted.
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
