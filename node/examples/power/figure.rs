//! The figure of `docs/samples.md`: how often updates pass, by the number of evaluated samples.

use crate::trials::Result;
use crate::updates::BANDED;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::register_font;
use std::fs;
use std::path::Path;

/// How often the updates of one origin pass, by the number of samples.
pub struct Curve {
    pub origin: String,
    /// The relative change of the loss over all samples.
    pub true_change: f64,
    /// Number of samples, and the share of claims that pass.
    pub points: Vec<(f64, f64)>,
}

/// Eight colours that people with any kind of colour vision can tell apart (Okabe and Ito, Color Universal Design, 2008).
const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
    RGBColor(120, 120, 120),
];

/// Draws the updates that improve by at least `min_improvement`, at least on almost all samples, on the left, and all others on the right.
pub fn draw(file: &Path, curves: &[Curve], min_improvement: f64) -> Result<()> {
    for style in [FontStyle::Normal, FontStyle::Bold] {
        register_font("sans-serif", style, epaint_default_fonts::UBUNTU_LIGHT)
            .map_err(|_| "the figure's font is broken")?;
    }
    let improve = |curve: &&Curve| curve.true_change <= -min_improvement || curve.origin == BANDED;
    let (better, others): (Vec<&Curve>, Vec<&Curve>) = curves.iter().partition(improve);
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, (1200, 460)).into_drawing_area();
        let failed = |error: &dyn std::fmt::Display| format!("drawing the figure: {error}");
        area.fill(&WHITE).map_err(|error| failed(&error))?;
        let (left, right) = area.split_horizontally(600);
        panel(
            &left,
            "Updates that improve almost all losses",
            &better,
            100.0,
        )
        .map_err(|error| failed(&error))?;
        panel(&right, "Updates that do not", &others, 2.0).map_err(|error| failed(&error))?;
        area.present().map_err(|error| failed(&error))?;
    }
    Ok(fs::write(file, text)?)
}

/// One panel, up to `top` percent.
fn panel<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    caption: &str,
    curves: &[&Curve],
    top: f64,
) -> std::result::Result<(), DrawingAreaErrorKind<B::ErrorType>> {
    let samples = curves.iter().flat_map(|curve| &curve.points);
    let (least, most) = samples.fold((f64::MAX, 1.0), |(least, most), (n, _)| {
        (n.min(least), n.max(most))
    });
    let mut chart = ChartBuilder::on(area)
        .caption(caption, ("sans-serif", 20))
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(55)
        .build_cartesian_2d((least.min(most)..most).log_scale().base(2.0), 0.0..top)?;
    chart
        .configure_mesh()
        .x_desc("evaluated samples")
        .y_desc("claims that pass (%)")
        .x_label_formatter(&|n| format!("{n:.0}"))
        .light_line_style(WHITE)
        .draw()?;
    for (curve, colour) in curves.iter().zip(COLOURS) {
        let points = curve.points.iter().map(|(n, share)| (*n, 100.0 * share));
        chart
            .draw_series(LineSeries::new(points, colour.stroke_width(2)).point_size(3))?
            .label(format!(
                "{} (truly {:+.1} %)",
                curve.origin,
                100.0 * curve.true_change
            ))
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(3)));
    }
    let position = match top > 50.0 {
        true => SeriesLabelPosition::LowerRight,
        false => SeriesLabelPosition::UpperRight,
    };
    chart
        .configure_series_labels()
        .position(position)
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK.mix(0.3))
        .draw()
}
