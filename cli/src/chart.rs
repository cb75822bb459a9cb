//! The loss chart: training curves of the nodes, and what the proofs say of the same losses.

use anyhow::{anyhow, Result};
use plotters::{coord::Shift, prelude::*, style::register_font};
use std::path::Path;

/// A curve with a name: (step, loss).
#[derive(Clone, Debug, serde::Serialize)]
pub struct Curve {
    /// Whose.
    pub name: String,
    /// Training step and mean loss there.
    pub points: Vec<(f64, f64)>,
}

/// A proven pair of losses.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Proven {
    /// Whose.
    pub name: String,
    /// Round.
    pub round: u64,
    /// Loss of the round's base weights on the challenged samples.
    pub before: f64,
    /// Loss of the update on the same samples, noise and times.
    pub after: f64,
}

/// Draws `curves` (left) and `proven` losses (right) to `stem.png` and `stem.svg`.
pub fn draw(stem: &Path, curves: &[Curve], proven: &[Proven]) -> Result<()> {
    for style in [FontStyle::Normal, FontStyle::Bold] {
        register_font("sans-serif", style, epaint_default_fonts::UBUNTU_LIGHT)
            .map_err(|_| anyhow!("the chart's font is broken"))?;
    }
    let size = (1200, 500);
    let (png, svg) = (stem.with_extension("png"), stem.with_extension("svg"));
    draw_on(
        BitMapBackend::new(&png, size).into_drawing_area(),
        curves,
        proven,
    )?;
    draw_on(
        SVGBackend::new(&svg, size).into_drawing_area(),
        curves,
        proven,
    )
}

fn draw_on<B: DrawingBackend>(
    area: DrawingArea<B, Shift>,
    curves: &[Curve],
    proven: &[Proven],
) -> Result<()> {
    let failed = |error: String| anyhow!("drawing the chart: {error}");
    area.fill(&WHITE).map_err(|e| failed(e.to_string()))?;
    let (left, right) = area.split_horizontally((62).percent_width());
    training(&left, curves).map_err(|e| failed(e.to_string()))?;
    proofs(&right, proven).map_err(|e| failed(e.to_string()))?;
    area.present().map_err(|e| failed(e.to_string()))
}

type Drawn<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

fn highest(values: impl Iterator<Item = f64>) -> f64 {
    values
        .filter(|v| v.is_finite())
        .fold(0.0, f64::max)
        .max(1e-6)
        * 1.1
}

fn training<B: DrawingBackend>(area: &DrawingArea<B, Shift>, curves: &[Curve]) -> Drawn<B> {
    let points = || curves.iter().flat_map(|curve| &curve.points);
    let last = points().map(|p| p.0).fold(1.0, f64::max);
    let mut chart = ChartBuilder::on(area)
        .caption(
            "Local training: flow-matching loss (mean over a window)",
            ("sans-serif", 20),
        )
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(55)
        .build_cartesian_2d(0.0..last, 0.0..highest(points().map(|p| p.1)))?;
    chart
        .configure_mesh()
        .x_desc("step")
        .y_desc("loss")
        .light_line_style(WHITE)
        .draw()?;
    for (i, curve) in curves.iter().enumerate() {
        let colour = Palette99::pick(i).to_rgba();
        chart
            .draw_series(LineSeries::new(
                curve.points.iter().copied(),
                colour.stroke_width(2),
            ))?
            .label(curve.name.clone())
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(3)));
    }
    chart
        .configure_series_labels()
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK.mix(0.3))
        .draw()
}

fn proofs<B: DrawingBackend>(area: &DrawingArea<B, Shift>, proven: &[Proven]) -> Drawn<B> {
    let count = proven.len().max(1) as f64;
    let mut chart = ChartBuilder::on(area)
        .caption("Proven: base and update", ("sans-serif", 20))
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(55)
        .build_cartesian_2d(
            0.0..count,
            0.0..highest(proven.iter().flat_map(|p| [p.before, p.after])),
        )?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .x_labels(2 * proven.len() + 1)
        .x_label_formatter(&|x| {
            let middle = (x.fract() - 0.5).abs() < 1e-6;
            let of = proven.get(*x as usize).filter(|_| middle);
            of.map(|p| format!("{}, round {}", p.name, p.round))
                .unwrap_or_default()
        })
        .light_line_style(WHITE)
        .draw()?;
    let bars = [
        ("base", 0.15, BLACK.mix(0.35)),
        ("update", 0.5, GREEN.mix(0.7)),
    ];
    for (name, offset, colour) in bars {
        chart
            .draw_series(proven.iter().enumerate().map(|(i, p)| {
                let x = i as f64 + offset;
                let loss = if name == "base" { p.before } else { p.after };
                Rectangle::new([(x, 0.0), (x + 0.35, loss)], colour.filled())
            }))?
            .label(name)
            .legend(move |(x, y)| Rectangle::new([(x, y - 5), (x + 14, y + 5)], colour.filled()));
    }
    chart
        .configure_series_labels()
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK.mix(0.3))
        .draw()
}
