//! Groups of bars.

use crate::chart::colours::{DrawResult, PaletteForAll};
use plotters::coord::Shift;
use plotters::prelude::*;

/// Groups of bars. [`Panel`](crate::chart::Panel) names their axis.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Bars {
    /// The text above.
    pub caption: String,
    /// What they measure.
    pub unit: String,
    /// The text below each group.
    pub groups: Vec<String>,
    /// Each series: its name, and its bar in every group.
    pub series: Vec<(String, Vec<f64>)>,
}

fn highest(values: impl Iterator<Item = f64>) -> f64 {
    values
        .filter(|v| v.is_finite())
        .fold(0.0, f64::max)
        .max(1e-6)
        * 1.1
}

/// Draws bars. `x` names their axis.
pub fn bars<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    x: &str,
    bars: &Bars,
) -> DrawResult<B> {
    let count = bars.groups.len();
    let values = bars.series.iter().flat_map(|(_, values)| values);
    let top = highest(values.copied()) * (1.0 + 0.08 * bars.series.len() as f64);
    let mut chart = ChartBuilder::on(area)
        .caption(&bars.caption, ("sans-serif", 20))
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(55)
        .build_cartesian_2d(0.0..count.max(1) as f64, 0.0..top)?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .x_labels(2 * count + 1)
        .x_label_formatter(&|x| {
            let middle = (x.fract() - 0.5).abs() < 1e-6;
            let of = bars.groups.get(*x as usize).filter(|_| middle);
            of.cloned().unwrap_or_default()
        })
        .x_desc(x)
        .y_desc(&bars.unit)
        .light_line_style(WHITE)
        .draw()?;
    // The first series is the reference.
    let width = 0.7 / bars.series.len().max(1) as f64;
    for (i, (name, values)) in bars.series.iter().enumerate() {
        let colour = match i {
            0 => BLACK.mix(0.35),
            _ => PaletteForAll::pick(i).mix(0.7),
        };
        let from = 0.15 + width * i as f64;
        chart
            .draw_series(values.iter().enumerate().map(|(group, value)| {
                let x = group as f64 + from;
                Rectangle::new([(x, 0.0), (x + width, *value)], colour.filled())
            }))?
            .label(name)
            .legend(move |(x, y)| Rectangle::new([(x, y - 5), (x + 14, y + 5)], colour.filled()));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK.mix(0.3))
        .draw()
}
