//! Differences with their intervals.

use crate::chart::colours::{DrawResult, PaletteForAll, GREY};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// A difference and its interval.
pub struct DifferenceRow {
    /// What differs from what.
    pub name: String,
    /// The low end.
    pub low: f64,
    /// The mean.
    pub mean: f64,
    /// The high end.
    pub high: f64,
}

/// Draws the rows downwards, with a line at 0. Intervals without 0 are coloured.
pub fn differences<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    rows: &[DifferenceRow],
) -> DrawResult<B> {
    let right = Pos::new(HPos::Right, VPos::Center);
    let font = ("sans-serif", 13).into_text_style(area).pos(right);
    let mut widest = 0;
    for row in rows {
        widest = widest.max(area.estimate_text_size(&row.name, &font)?.0 as i32);
    }
    let (names, plot) = area.split_horizontally(widest + 16);
    let all = || rows.iter().flat_map(|row| [row.low, row.high, 0.0]);
    let (low, high) = (all().fold(0.0, f64::min), all().fold(0.0, f64::max));
    let room = (0.06 * (high - low)).max(1e-6);
    let count = rows.len().max(1) as f64;
    let mut chart = ChartBuilder::on(&plot)
        .caption(
            "Federated minus the others, with 95 % intervals",
            ("sans-serif", 20),
        )
        .margin(12)
        .x_label_area_size(40)
        .build_cartesian_2d(low - room..high + room, 0.0..count)?;
    chart
        .configure_mesh()
        .disable_y_mesh()
        .disable_y_axis()
        .x_labels(8)
        .x_desc("difference of losses: below 0, the federation is better")
        .light_line_style(WHITE)
        .draw()?;
    let none = [(0.0, 0.0), (0.0, count)];
    chart.draw_series([PathElement::new(none, BLACK.mix(0.6).stroke_width(1))])?;
    let top = names.get_pixel_range().1.start;
    for (number, row) in rows.iter().enumerate() {
        let y = count - number as f64 - 0.5;
        let colour = match (row.low, row.high) {
            (_, high) if high < 0.0 => PaletteForAll::pick(0).to_rgba(),
            (low, _) if low > 0.0 => PaletteForAll::pick(1).to_rgba(),
            _ => GREY.to_rgba(),
        };
        let ends = [(row.low, y), (row.high, y)];
        chart.draw_series([PathElement::new(ends, colour.stroke_width(3))])?;
        chart.draw_series([Circle::new((row.mean, y), 5, colour.filled())])?;
        let middle = chart.backend_coord(&(0.0, y)).1 - top;
        names.draw(&Text::new(
            row.name.clone(),
            (widest + 12, middle),
            font.clone(),
        ))?;
    }
    Ok(())
}
