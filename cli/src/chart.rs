//! Charts: training curves, the losses that proofs show, and bars that compare policies. Each chart is drawn as PNG and as SVG. The data
//! of training curves is also written as JSON.

use anyhow::{anyhow, Context, Result};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::register_font;
use std::fs::File;
use std::path::Path;
use zk0_files::atomic_file;

/// A curve with a name: losses by step or by round.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Curve {
    /// What the curve shows.
    pub name: String,
    /// Training step or round, and the loss there.
    pub points: Vec<(f64, f64)>,
}

/// A proven pair of losses.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Proven {
    /// The node.
    pub name: String,
    /// The round.
    pub round: u64,
    /// Loss of the round's base weights on the challenged samples.
    pub before: f64,
    /// Loss of the update on the same samples, noise and times.
    pub after: f64,
}

/// Groups of bars. What the groups are is the name of their axis, see [`Panel`].
#[derive(Clone, Debug, serde::Serialize)]
pub struct Bars {
    /// The text above them.
    pub caption: String,
    /// What they measure.
    pub unit: String,
    /// Below each group.
    pub groups: Vec<String>,
    /// For each series its name, and its bar in every group.
    pub series: Vec<(String, Vec<f64>)>,
}

/// Bars, and the name of the axis below them.
#[derive(Clone, Debug)]
pub struct Panel {
    /// What the groups are.
    pub x: &'static str,
    /// The bars.
    pub bars: Bars,
}

/// Draws `curves`, `proven` losses and those of the `global` weights on each recording, from left to right, to `stem.png` and `stem.svg`.
pub fn draw(stem: &Path, curves: &[Curve], proven: &[Proven], global: &Bars) -> Result<()> {
    let pair = |of: fn(&Proven) -> f64| proven.iter().map(of).collect();
    let bars = Bars {
        caption: "Proven: base and update".into(),
        unit: "mean squared error".into(),
        groups: proven
            .iter()
            .map(|p| format!("{}, round {}", p.name, p.round))
            .collect(),
        series: vec![
            ("base".into(), pair(|p| p.before)),
            ("update".into(), pair(|p| p.after)),
        ],
    };
    save(
        stem,
        (1600, 500),
        &Picture::Federation(curves, [("node and round", &bars), ("recording", global)]),
    )
}

/// Draws the curves of one run to `stem.png` and `stem.svg`, and writes them to `stem.json`.
pub fn draw_training(stem: &Path, curves: &[Curve]) -> Result<()> {
    write_json(stem, &curves)?;
    save(stem, (900, 500), &Picture::Training(curves))
}

/// Draws losses by round to `stem.png` and `stem.svg`, and writes them to `stem.json`.
pub fn draw_rounds(stem: &Path, curves: &[Curve]) -> Result<()> {
    write_json(stem, &curves)?;
    save(stem, (900, 500), &Picture::Rounds(curves))
}

/// Draws rows of two groups of bars each to `stem.png` and `stem.svg`, the rows below one another.
pub fn draw_bars(stem: &Path, rows: &[[Panel; 2]]) -> Result<()> {
    let height = 360 * rows.len().clamp(1, 50) as u32;
    save(stem, (1200, height), &Picture::Rows(rows))
}

fn write_json(stem: &Path, data: &impl serde::Serialize) -> Result<()> {
    let path = stem.with_extension("json");
    atomic_file::replace(&path, &serde_json::to_vec(data)?)
        .with_context(|| format!("writing {}", path.display()))
}

/// What is drawn, on any backend.
enum Picture<'a> {
    /// The bars with the names of their axes.
    Federation(&'a [Curve], [(&'a str, &'a Bars); 2]),
    Training(&'a [Curve]),
    Rounds(&'a [Curve]),
    Rows(&'a [[Panel; 2]]),
}

type Drawn<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

impl Picture<'_> {
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawn<B> {
        match self {
            Self::Federation(curves, [proven, global]) => {
                let (left, rest) = area.split_horizontally((42).percent_width());
                let (middle, right) = rest.split_horizontally((50).percent_width());
                lines(&left, TRAINING, curves)?;
                bars(&middle, proven.0, proven.1)?;
                bars(&right, global.0, global.1)
            }
            Self::Training(curves) => lines(area, TRAINING, curves),
            Self::Rounds(curves) => lines(area, ROUNDS, curves),
            Self::Rows(rows) => {
                let areas = area.split_evenly((rows.len().max(1), 1));
                areas.iter().zip(*rows).try_for_each(|(area, row)| {
                    let (left, right) = area.split_horizontally((38).percent_width());
                    bars(&left, row[0].x, &row[0].bars)?;
                    bars(&right, row[1].x, &row[1].bars)
                })
            }
        }
    }
}

fn save(stem: &Path, size: (u32, u32), picture: &Picture) -> Result<()> {
    for style in [FontStyle::Normal, FontStyle::Bold] {
        register_font("sans-serif", style, epaint_default_fonts::UBUNTU_LIGHT)
            .map_err(|_| anyhow!("the chart's font is broken"))?;
    }
    // The backend takes the format from the file's extension.
    let unfinished = stem.with_extension("unfinished.png");
    let area = BitMapBackend::new(&unfinished, size).into_drawing_area();
    draw_on(area, picture)?;
    let png = stem.with_extension("png");
    File::open(&unfinished)
        .and_then(|file| atomic_file::put_in_place(&file, &unfinished, &png))
        .with_context(|| format!("writing {}", png.display()))?;

    let (mut text, svg) = (String::new(), stem.with_extension("svg"));
    let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
    draw_on(area, picture)?;
    atomic_file::replace(&svg, text.as_bytes())
        .with_context(|| format!("writing {}", svg.display()))
}

fn draw_on<B: DrawingBackend>(area: DrawingArea<B, Shift>, picture: &Picture) -> Result<()> {
    let failed = |error: String| anyhow!("drawing the chart: {error}");
    area.fill(&WHITE).map_err(|e| failed(e.to_string()))?;
    picture.draw(&area).map_err(|e| failed(e.to_string()))?;
    area.present().map_err(|e| failed(e.to_string()))
}

/// Eight colours that people with any kind of colour vision can tell apart (Okabe and Ito, Color Universal Design, 2008).
struct PaletteForAll;

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

fn highest(values: impl Iterator<Item = f64>) -> f64 {
    values
        .filter(|v| v.is_finite())
        .fold(0.0, f64::max)
        .max(1e-6)
        * 1.1
}

/// The text above curves, and the name of the axis below them.
type Titles = [&'static str; 2];

const TRAINING: Titles = ["Local training: mean over a window", "optimiser step"];
const ROUNDS: Titles = ["Loss of the global weights", "round"];

/// Draws curves of losses.
fn lines<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    [caption, x]: Titles,
    curves: &[Curve],
) -> Drawn<B> {
    let points = || curves.iter().flat_map(|curve| &curve.points);
    let last = points().map(|p| p.0).fold(1.0, f64::max);
    let mut chart = ChartBuilder::on(area)
        .caption(caption, ("sans-serif", 20))
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(55)
        .build_cartesian_2d(0.0..last, 0.0..highest(points().map(|p| p.1)))?;
    chart
        .configure_mesh()
        .x_desc(x)
        .y_desc("flow-matching loss (mean squared error)")
        .light_line_style(WHITE)
        .draw()?;
    for (i, curve) in curves.iter().enumerate() {
        let colour = PaletteForAll::pick(i).to_rgba();
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
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK.mix(0.3))
        .draw()
}

/// Draws bars. `x` says what their groups are.
fn bars<B: DrawingBackend>(area: &DrawingArea<B, Shift>, x: &str, bars: &Bars) -> Drawn<B> {
    let count = bars.groups.len();
    let values = bars.series.iter().flat_map(|(_, values)| values);
    // The names of the series have room above the bars.
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
    // The other series are compared with the first one.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn some_bars(caption: &str) -> Bars {
        Bars {
            caption: caption.into(),
            unit: format!("unit of {caption}"),
            groups: vec!["first".into(), "second".into()],
            series: vec![("series".into(), vec![1.0, 2.0])],
        }
    }

    /// The texts of an SVG, each of which the backend writes on a line of its own.
    fn texts(svg: &Path) -> Vec<String> {
        let text = std::fs::read_to_string(svg).unwrap();
        let lines = text.lines().map(str::trim);
        let texts = lines.filter(|line| !line.is_empty() && !line.starts_with('<'));
        texts.map(str::to_owned).collect()
    }

    fn assert_has(texts: &[String], names: &[&str]) {
        for name in names {
            assert!(texts.iter().any(|text| text == name), "{name}: {texts:?}");
        }
    }

    #[test]
    fn each_panel_of_a_demos_chart_names_both_axes() {
        let dir = tempfile::tempdir().unwrap();
        let curve = Curve {
            name: "node".into(),
            points: vec![(0.0, 2.0), (25.0, 1.0)],
        };
        let proven = Proven {
            name: "node".into(),
            round: 0,
            before: 2.0,
            after: 1.0,
        };
        let stem = dir.path().join("loss");
        draw(&stem, &[curve], &[proven], &some_bars("global")).unwrap();
        let training = ["optimiser step", "flow-matching loss (mean squared error)"];
        let proven = ["node and round", "mean squared error", "node, round 0"];
        let global = ["recording", "unit of global", "first", "second"];
        let texts = texts(&stem.with_extension("svg"));
        assert_has(&texts, &[&training[..], &proven, &global].concat());
    }

    #[test]
    fn bars_of_an_evaluation_name_both_axes() {
        let dir = tempfile::tempdir().unwrap();
        let panel = |x: &'static str| Panel {
            x,
            bars: some_bars(x),
        };
        let stem = dir.path().join("eval");
        draw_bars(&stem, &[[panel("kind of loss"), panel("joint")]]).unwrap();
        let texts = texts(&stem.with_extension("svg"));
        let units = ["unit of kind of loss", "unit of joint"];
        assert_has(&texts, &[&["kind of loss", "joint"][..], &units].concat());
        // A caption is a text of its own, so that each name is there twice.
        let joints = texts.iter().filter(|text| *text == "joint");
        assert_eq!(joints.count(), 2);
    }
}
