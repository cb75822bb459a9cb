//! Charts as PNG and SVG. Training curves are also written as JSON.

mod bars;
mod colours;
mod curves;
mod differences;

use anyhow::{anyhow, Context, Result};
use bars::bars;
use colours::DrawResult;
use curves::{bands, lines, PROGRESS, ROUNDS, TRAINING};
use differences::differences;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::register_font;
use std::fs::File;
use std::ops::Range;
use std::path::Path;
use zk0_files::atomic_file;

pub use bars::Bars;
pub use curves::{Band, Curve};
pub use differences::DifferenceRow;

/// A proven pair of losses.
#[derive(Clone, Debug, serde::Serialize)]
pub struct ProvenLosses {
    /// The node.
    pub name: String,
    /// The round.
    pub round: u64,
    /// Loss of the base weights on the challenged samples.
    pub before: f64,
    /// Loss of the update with the same samples, noise and times.
    pub after: f64,
}

/// Bars, and the name of their axis.
#[derive(Clone, Debug)]
pub struct Panel {
    /// What the groups are.
    pub x: &'static str,
    /// The bars.
    pub bars: Bars,
}

/// Draws `curves`, `proven` and `global` losses from left to right, to `stem.png` and `stem.svg`.
pub fn draw(stem: &Path, curves: &[Curve], proven: &[ProvenLosses], global: &Bars) -> Result<()> {
    let pair = |of: fn(&ProvenLosses) -> f64| proven.iter().map(of).collect();
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
        &Figure::Federation(curves, [("node and round", &bars), ("recording", global)]),
    )
}

/// Writes the curves of one run to `stem.png`, `stem.svg` and `stem.json`.
pub fn draw_training(stem: &Path, curves: &[Curve]) -> Result<()> {
    write_json(stem, &curves)?;
    save(stem, (900, 500), &Figure::Training(curves))
}

/// Writes losses by round to `stem.png`, `stem.svg` and `stem.json`. Many curves of `nodes` are thin and grey, behind the others.
pub fn draw_rounds(stem: &Path, curves: &[Curve], nodes: Range<usize>) -> Result<()> {
    write_json(stem, &curves)?;
    save(stem, (900, 500), &Figure::Rounds(curves, nodes))
}

/// Draws losses by round and differences, with intervals, to `stem.png` and `stem.svg`.
pub fn draw_comparison(stem: &Path, progress: &[Band], rows: &[DifferenceRow]) -> Result<()> {
    let height = 180 + 30 * rows.len().clamp(11, 100) as u32;
    save(stem, (1500, height), &Figure::Comparison(progress, rows))
}

/// Draws rows of two panels to `stem.png` and `stem.svg`.
pub fn draw_bars(stem: &Path, rows: &[[Panel; 2]]) -> Result<()> {
    let height = 360 * rows.len().clamp(1, 50) as u32;
    save(stem, (1200, height), &Figure::Rows(rows))
}

fn write_json(stem: &Path, data: &impl serde::Serialize) -> Result<()> {
    let path = stem.with_extension("json");
    atomic_file::replace(&path, &serde_json::to_vec(data)?)
        .with_context(|| format!("writing {}", path.display()))
}

enum Figure<'a> {
    Federation(&'a [Curve], [(&'a str, &'a Bars); 2]),
    Training(&'a [Curve]),
    Rounds(&'a [Curve], Range<usize>),
    Rows(&'a [[Panel; 2]]),
    Comparison(&'a [Band], &'a [DifferenceRow]),
}

impl Figure<'_> {
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> DrawResult<B> {
        match self {
            Self::Federation(curves, [proven, global]) => {
                let (left, rest) = area.split_horizontally((42).percent_width());
                let (middle, right) = rest.split_horizontally((50).percent_width());
                lines(&left, TRAINING, curves, 0..0)?;
                bars(&middle, proven.0, proven.1)?;
                bars(&right, global.0, global.1)
            }
            Self::Training(curves) => lines(area, TRAINING, curves, 0..0),
            Self::Rounds(curves, nodes) => lines(area, ROUNDS, curves, nodes.clone()),
            Self::Comparison(progress, rows) => {
                let (left, right) = area.split_horizontally((45).percent_width());
                bands(&left, PROGRESS, progress)?;
                differences(&right, rows)
            }
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

fn save(stem: &Path, size: (u32, u32), picture: &Figure) -> Result<()> {
    for style in [FontStyle::Normal, FontStyle::Bold] {
        register_font("sans-serif", style, epaint_default_fonts::UBUNTU_LIGHT)
            .map_err(|_| anyhow!("the chart's font is broken"))?;
    }
    // The extension tells the backend the format.
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

fn draw_on<B: DrawingBackend>(area: DrawingArea<B, Shift>, picture: &Figure) -> Result<()> {
    let failed = |error: String| anyhow!("drawing the chart: {error}");
    area.fill(&WHITE).map_err(|e| failed(e.to_string()))?;
    picture.draw(&area).map_err(|e| failed(e.to_string()))?;
    area.present().map_err(|e| failed(e.to_string()))
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

    /// The backend writes each text on its own line.
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
        let proven = ProvenLosses {
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
        // The captions are texts, too.
        let joints = texts.iter().filter(|text| *text == "joint");
        assert_eq!(joints.count(), 2);
    }

    fn curve(name: &str) -> Curve {
        Curve {
            name: name.into(),
            points: vec![(0.0, 2.0), (10.0, 1.0)],
        }
    }

    /// Pixels from the left.
    fn place(svg: &Path, text: &str) -> i32 {
        let all = std::fs::read_to_string(svg).unwrap();
        let before = all.split(&format!("\n{text}\n")).next().unwrap();
        assert!(before.len() < all.len(), "{text}");
        let from = before.rfind("<text x=\"").unwrap() + "<text x=\"".len();
        let number: String = before[from..].chars().take_while(|c| *c != '"').collect();
        number.parse().unwrap()
    }

    #[test]
    fn names_of_curves_stand_beside_them() {
        let dir = tempfile::tempdir().unwrap();
        let stem = dir.path().join("loss");
        let names = [
            "mean",
            "node-1",
            "node-2",
            "a long name of a recording (unseen)",
        ];
        draw_rounds(&stem, &names.map(curve), 1..3).unwrap();
        let svg = stem.with_extension("svg");
        for name in names {
            assert!(place(&svg, name) > place(&svg, "10.0"), "{name}");
        }
    }

    #[test]
    fn many_nodes_share_a_name() {
        let dir = tempfile::tempdir().unwrap();
        let stem = dir.path().join("loss");
        let nodes = (1..=40).map(|node| curve(&format!("node-{node}")));
        let mean = std::iter::once(curve("mean"));
        let curves: Vec<_> = mean.chain(nodes).chain([curve("unseen")]).collect();
        draw_rounds(&stem, &curves, 1..41).unwrap();
        let texts = texts(&stem.with_extension("svg"));
        assert_has(&texts, &["mean", "unseen", "each of 40 nodes"]);
        assert!(!texts.iter().any(|text| text == "node-7"), "{texts:?}");
    }

    #[test]
    fn a_comparison_names_its_rows_and_both_axes() {
        let dir = tempfile::tempdir().unwrap();
        let stem = dir.path().join("comparison");
        let band = Band {
            name: "federated".into(),
            points: vec![(0.0, [2.0, 2.1, 2.2]), (10.0, [0.9, 1.0, 1.1])],
        };
        let row = |name: &str, [low, mean, high]: [f64; 3]| DifferenceRow {
            name: name.into(),
            low,
            mean,
            high,
        };
        let rows = [
            row("held out: minus alone", [-0.3, -0.2, -0.1]),
            row("unseen: minus alone", [-0.1, 0.0, 0.1]),
        ];
        draw_comparison(&stem, &[band], &rows).unwrap();
        let names = ["federated", "held out: minus alone", "unseen: minus alone"];
        let axes = [
            "round",
            "difference of losses: below 0, the federation is better",
        ];
        assert_has(
            &texts(&stem.with_extension("svg")),
            &[&names[..], &axes].concat(),
        );
    }
}
