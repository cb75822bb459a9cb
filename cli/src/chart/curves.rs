//! Curves of losses, and bands of intervals.

use crate::chart::colours::{beside, DrawResult, LegendEntry, PaletteForAll, GREY};
use plotters::coord::types::RangedCoordf64;
use plotters::coord::Shift;
use plotters::prelude::*;
use std::ops::Range;

/// Most nodes with their own colours and names.
const NAMED_NODES: usize = 6;

/// The title, and the lower axis's name.
pub type Titles = [&'static str; 2];

/// Curves of a training run.
pub const TRAINING: Titles = ["Local training: mean over a window", "optimiser step"];
/// Curves of a federation.
pub const ROUNDS: Titles = ["Loss of the global weights", "round"];
/// Bands of a comparison.
pub const PROGRESS: Titles = [
    "Loss on the held-out episodes of those who trained",
    "round",
];

/// A named curve of losses by step or round.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Curve {
    /// Its name.
    pub name: String,
    /// Step or round, and the loss there.
    pub points: Vec<(f64, f64)>,
}

/// Means with an interval around each.
pub struct Band {
    /// Its name.
    pub name: String,
    /// Round; low end, mean and high end.
    pub points: Vec<(f64, [f64; 3])>,
}

type Axes<'a, B> = ChartContext<'a, B, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

fn axes<'a, B: DrawingBackend + 'a>(
    area: &'a DrawingArea<B, Shift>,
    [caption, x]: Titles,
    points: &[(f64, f64)],
) -> DrawResult<B, Axes<'a, B>> {
    let last = points.iter().map(|point| point.0).fold(1.0, f64::max);
    let finite = points
        .iter()
        .map(|point| point.1)
        .filter(|loss| loss.is_finite());
    let highest = finite.fold(0.0, f64::max).max(1e-6) * 1.1;
    let mut chart = ChartBuilder::on(area)
        .caption(caption, ("sans-serif", 20))
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(55)
        .build_cartesian_2d(0.0..last, 0.0..highest)?;
    chart
        .configure_mesh()
        .x_desc(x)
        .y_desc("flow-matching loss (mean squared error)")
        .light_line_style(WHITE)
        .draw()?;
    Ok(chart)
}

/// Draws curves of losses. `nodes` are single nodes'.
pub fn lines<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    titles: Titles,
    curves: &[Curve],
    nodes: Range<usize>,
) -> DrawResult<B> {
    let behind = if nodes.len() > NAMED_NODES {
        nodes
    } else {
        0..0
    };
    let (grey, named): (Vec<_>, Vec<_>) = curves
        .iter()
        .enumerate()
        .partition(|(number, _)| behind.contains(number));
    let colours = (0..named.len()).map(|number| PaletteForAll::pick(number).to_rgba());
    let mut keys: Vec<LegendEntry> = named
        .iter()
        .zip(colours)
        .map(|((_, curve), colour)| LegendEntry {
            name: curve.name.clone(),
            colour,
        })
        .collect();
    if !grey.is_empty() {
        keys.push(LegendEntry {
            name: format!("each of {} nodes", grey.len()),
            colour: GREY.to_rgba(),
        });
    }
    let area = beside(area, &keys)?;
    let points: Vec<_> = curves
        .iter()
        .flat_map(|curve| &curve.points)
        .copied()
        .collect();
    let mut chart = axes(&area, titles, &points)?;
    let grey = grey
        .iter()
        .map(|(_, curve)| (curve, GREY.mix(0.5).stroke_width(1)));
    let named = named.iter().zip(&keys);
    let named = named.map(|((_, curve), key)| (curve, key.colour.stroke_width(2)));
    for (curve, style) in grey.chain(named) {
        chart.draw_series(LineSeries::new(curve.points.iter().copied(), style))?;
    }
    Ok(())
}

/// Draws means with bands of intervals.
pub fn bands<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    titles: Titles,
    bands: &[Band],
) -> DrawResult<B> {
    let keys = bands.iter().enumerate().map(|(number, band)| LegendEntry {
        name: band.name.clone(),
        colour: PaletteForAll::pick(number).to_rgba(),
    });
    let keys: Vec<LegendEntry> = keys.collect();
    let area = beside(area, &keys)?;
    let all = bands.iter().flat_map(|band| &band.points);
    let points: Vec<_> = all.map(|(round, [_, _, high])| (*round, *high)).collect();
    let mut chart = axes(&area, titles, &points)?;
    for (band, key) in bands.iter().zip(&keys) {
        let at = |which: usize| {
            band.points
                .iter()
                .map(move |(x, interval)| (*x, interval[which]))
        };
        let around: Vec<_> = at(0).chain(at(2).rev()).collect();
        chart.draw_series([Polygon::new(around, key.colour.mix(0.2).filled())])?;
        chart.draw_series(LineSeries::new(at(1), key.colour.stroke_width(2)))?;
    }
    Ok(())
}
