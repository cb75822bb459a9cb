//! SVG charts for a page: stacked bars, lying bars, and lines. Text is escaped, and nothing is loaded.

use std::fmt::Write;

/// Colours distinct for colour-blind readers (Okabe and Ito), on white.
pub const COLOURS: [&str; 8] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#999999", "#000000",
];

/// The colour of acceptance.
pub const GOOD: &str = "#009e73";

/// The colour of refusal.
pub const BAD: &str = "#d55e00";

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 260.0;
const LEFT: f64 = 84.0;
const RIGHT: f64 = 12.0;
const TOP: f64 = 26.0;
const BOTTOM: f64 = 40.0;

/// A finished chart.
pub struct Svg(String);

impl Svg {
    /// The element.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

/// Text in an element or an attribute.
pub fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            // HTML and XML do not allow these characters.
            c if c.is_control() && c != '\n' && c != '\t' => {
                let _ = write!(escaped, "{}", c.escape_default());
            }
            c => escaped.push(c),
        }
    }
    escaped
}

/// A line or a kind of bars in a chart.
pub struct Series<'a> {
    /// The name in the legend.
    pub name: String,
    /// The colour.
    pub colour: &'a str,
    /// The value at each place, if any.
    pub values: Vec<Option<f64>>,
}

/// The axis of places.
pub struct PlotAxis<'a> {
    /// The axis's name.
    pub name: &'a str,
    /// Each place's name.
    pub places: Vec<String>,
}

/// Bars over the places of `x`, with stacked series. `y` names what is counted.
pub fn stacked(title: &str, x: &PlotAxis<'_>, y: &str, series: &[Series<'_>]) -> Svg {
    let labels = &x.places;
    let total = |at: usize| -> f64 {
        let at = |one: &Series<'_>| one.values.get(at).copied().flatten();
        series.iter().filter_map(at).sum()
    };
    let most = (0..labels.len()).map(total).fold(0.0, f64::max);
    let mut chart = Chart::new(title, (0.0, most), true);
    chart.axes(x, y);
    chart.legend(series);
    let step = chart.step(labels.len());
    let width = (step * 0.8).min(48.0);
    for at in 0..labels.len() {
        let x = chart.centre(at, labels.len()) - width / 2.0;
        let mut base = 0.0;
        for one in series {
            let Some(value) = one.values.get(at).copied().flatten() else {
                continue;
            };
            let (top, bottom) = (chart.y(base + value), chart.y(base));
            base += value;
            let reports = format!("{}: {} {}", labels[at], number(value), one.name);
            chart.rect((x, top), (width, bottom - top), one.colour, &reports);
        }
    }
    chart.finish()
}

/// Lines over the places of `x`. `y` names what is measured. `from_zero` is for counts.
pub fn lines(
    title: &str,
    x: &PlotAxis<'_>,
    y: &str,
    series: &[Series<'_>],
    from_zero: bool,
) -> Svg {
    let labels = &x.places;
    let values = || {
        series
            .iter()
            .flat_map(|one| one.values.iter().flatten().copied())
    };
    let most = values().fold(f64::MIN, f64::max);
    let least = if from_zero {
        0.0
    } else {
        values().fold(f64::MAX, f64::min)
    };
    let mut chart = Chart::new(title, (least.min(most), most.max(least)), from_zero);
    chart.axes(x, y);
    chart.legend(series);
    for one in series {
        let mut points: Vec<(f64, f64, f64)> = Vec::new();
        for (at, value) in one.values.iter().enumerate() {
            if let Some(value) = value {
                points.push((chart.centre(at, labels.len()), chart.y(*value), *value));
            }
        }
        let path: Vec<String> = points
            .iter()
            .map(|(x, y, _)| format!("{x:.1},{y:.1}"))
            .collect();
        chart.element(&format!(
            "<polyline fill=\"none\" stroke=\"{}\" stroke-width=\"2\" points=\"{}\"/>",
            escape(one.colour),
            path.join(" ")
        ));
        // Circles show a few points, but hide a line of many.
        if points.len() <= 60 {
            for (x, y, value) in points {
                let title = escape(&format!("{}: {}", one.name, number(value)));
                chart.element(&format!(
                    "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"{}\"><title>{title}</title></circle>",
                    escape(one.colour)
                ));
            }
        }
    }
    chart.finish()
}

/// Lying bars with name, value and colour. `names` describes the names, and `unit` what is counted.
pub fn lying(title: &str, names: &str, unit: &str, bars: &[(String, f64, &str)]) -> Svg {
    const ROW: f64 = 24.0;
    const NAMES: f64 = 210.0;
    let most = bars.iter().map(|(_, value, _)| *value).fold(1.0, f64::max);
    let height = TOP + ROW * bars.len() as f64 + 22.0;
    let mut body = format!(
        "<text x=\"{:.0}\" y=\"13\" text-anchor=\"end\">{}</text><text x=\"{NAMES}\" y=\"{:.1}\">{}</text>",
        NAMES - 8.0,
        escape(names),
        height - 6.0,
        escape(unit)
    );
    for (at, (name, value, colour)) in bars.iter().enumerate() {
        let y = TOP + ROW * at as f64;
        let width = (WIDTH - NAMES - 70.0) * value / most;
        let _ = write!(
            body,
            "<text x=\"{:.0}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>\
             <rect x=\"{NAMES}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{}\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            NAMES - 8.0,
            y + ROW * 0.65,
            escape(&short(name, 32)),
            y + 3.0,
            width.max(1.0),
            ROW - 7.0,
            escape(colour),
            NAMES + width.max(1.0) + 6.0,
            y + ROW * 0.65,
            number(*value)
        );
    }
    Svg(element(title, height, &body))
}

struct Chart {
    title: String,
    body: String,
    low: f64,
    high: f64,
}

impl Chart {
    /// A chart of values between `low` and `high`. `from_zero` means counts: the scale begins at 0 and has whole steps.
    fn new(title: &str, (low, high): (f64, f64), from_zero: bool) -> Self {
        // Without values, `low` and `high` are the largest and the smallest number.
        let usable = low.is_finite() && high.is_finite() && (high - low).is_finite();
        let (low, high) = if usable { (low, high) } else { (0.0, 1.0) };
        let span = match high - low {
            span if span > 0.0 => span,
            _ => high.abs().max(1.0) * 0.1,
        };
        let step = if from_zero {
            nice(span / 4.0).max(1.0)
        } else {
            nice(span / 4.0)
        };
        let bottom = if from_zero {
            0.0
        } else {
            (low / step).floor() * step
        };
        let mut chart = Self {
            title: title.into(),
            body: String::new(),
            low: bottom,
            high: (high / step).ceil().max((bottom / step).round() + 1.0) * step,
        };
        let ticks = ((chart.high - chart.low) / step).round() as usize;
        for tick in 0..=ticks.min(12) {
            let value = chart.low + step * tick as f64;
            let y = chart.y(value);
            chart.element(&format!(
                "<line x1=\"{LEFT}\" x2=\"{:.0}\" y1=\"{y:.1}\" y2=\"{y:.1}\" stroke=\"#ddd\"/>\
                 <text x=\"{:.0}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                WIDTH - RIGHT,
                LEFT - 6.0,
                y + 4.0,
                number(value)
            ));
        }
        chart
    }

    fn y(&self, value: f64) -> f64 {
        let share = (value - self.low) / (self.high - self.low);
        HEIGHT - BOTTOM - share * (HEIGHT - BOTTOM - TOP)
    }

    fn step(&self, count: usize) -> f64 {
        (WIDTH - LEFT - RIGHT) / count.max(1) as f64
    }

    fn centre(&self, at: usize, count: usize) -> f64 {
        LEFT + self.step(count) * (at as f64 + 0.5)
    }

    /// The names of both axes, and of as many places as fit.
    fn axes(&mut self, x: &PlotAxis<'_>, y: &str) {
        let labels = &x.places;
        let every = labels.len().div_ceil(12).max(1);
        for (at, label) in labels.iter().enumerate().step_by(every) {
            let centre = self.centre(at, labels.len());
            self.element(&format!(
                "<text x=\"{centre:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                HEIGHT - BOTTOM + 16.0,
                escape(&short(label, 14))
            ));
        }
        self.element(&format!(
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            LEFT + (WIDTH - LEFT - RIGHT) / 2.0,
            HEIGHT - 6.0,
            escape(x.name)
        ));
        self.element(&format!(
            "<text transform=\"translate(14 {:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            TOP + (HEIGHT - TOP - BOTTOM) / 2.0,
            escape(y)
        ));
    }

    fn legend(&mut self, series: &[Series<'_>]) {
        let mut x = LEFT;
        for one in series {
            let name = short(&one.name, 16);
            self.element(&format!(
                "<rect x=\"{x:.1}\" y=\"4\" width=\"10\" height=\"10\" fill=\"{}\"/>\
                 <text x=\"{:.1}\" y=\"13\">{}</text>",
                escape(one.colour),
                x + 14.0,
                escape(&name)
            ));
            x += 26.0 + 6.5 * name.chars().count() as f64;
        }
    }

    fn rect(
        &mut self,
        (x, y): (f64, f64),
        (width, height): (f64, f64),
        colour: &str,
        reports: &str,
    ) {
        self.element(&format!(
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" fill=\"{}\"><title>{}</title></rect>",
            escape(colour),
            escape(reports)
        ));
    }

    fn element(&mut self, element: &str) {
        self.body.push_str(element);
    }

    fn finish(self) -> Svg {
        Svg(element(&self.title, HEIGHT, &self.body))
    }
}

fn element(title: &str, height: f64, body: &str) -> String {
    format!(
        "<svg role=\"img\" viewBox=\"0 0 {WIDTH} {height:.0}\" width=\"100%\" font-family=\"sans-serif\" font-size=\"11\" \
         fill=\"#333\"><title>{}</title>{body}</svg>",
        escape(title)
    )
}

/// A step of 1, 2 or 5 times a power of ten, at least `step`.
fn nice(step: f64) -> f64 {
    let power = 10f64.powf(step.log10().floor());
    let digits = [1.0, 2.0, 5.0, 10.0];
    let fits = |digit: &&f64| *digit * power >= step * 0.999_999;
    digits.iter().find(fits).unwrap_or(&10.0) * power
}

fn number(value: f64) -> String {
    let text = match value.abs() {
        size if size >= 1e6 => format!("{value:.3e}"),
        size if size >= 100.0 || value.fract() == 0.0 => format!("{value:.0}"),
        size if size >= 1.0 => format!("{value:.2}"),
        _ => format!("{value:.5}"),
    };
    if text.contains('.') && !text.contains('e') {
        text.trim_end_matches('0').trim_end_matches('.').into()
    } else {
        text
    }
}

fn short(text: &str, most: usize) -> String {
    if text.chars().count() > most {
        text.chars().take(most - 1).chain(['…']).collect()
    } else {
        text.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_round_and_numbers_short() {
        for (step, expected) in [
            (0.3, 0.5),
            (1.0, 1.0),
            (7.0, 10.0),
            (0.0021, 0.005),
            (1200.0, 2000.0),
        ] {
            assert!((nice(step) - expected).abs() < expected * 1e-9, "{step}");
        }
        for (value, text) in [
            (0.0, "0"),
            (3.0, "3"),
            (0.25, "0.25"),
            (1234.5, "1234"),
            (0.012_345, "0.01235"),
        ] {
            assert_eq!(number(value), text);
        }
    }

    #[test]
    fn every_chart_names_both_axes() {
        let axis = PlotAxis {
            name: "the x axis",
            places: vec!["one".into()],
        };
        let series = [Series {
            name: "series".into(),
            colour: GOOD,
            values: vec![Some(2.0)],
        }];
        let bars = [("one".to_owned(), 2.0, GOOD)];
        for svg in [
            stacked("title", &axis, "the y axis", &series),
            lines("title", &axis, "the y axis", &series, false),
            lying("title", "the x axis", "the y axis", &bars),
        ] {
            for name in ["the x axis", "the y axis"] {
                let text = format!(">{name}</text>");
                assert!(svg.as_str().contains(&text), "{name}: {}", svg.as_str());
            }
        }
    }

    #[test]
    fn a_chart_of_nothing_or_of_anything_is_well_formed() {
        let hostile = "<script>alert('1')</script>\u{0}\"&";
        let series = |values: Vec<Option<f64>>| {
            [Series {
                name: hostile.into(),
                colour: GOOD,
                values,
            }]
        };
        let axis = |count: usize| PlotAxis {
            name: hostile,
            places: vec![hostile.to_owned(); count],
        };
        for values in [
            vec![],
            vec![None],
            vec![Some(0.0)],
            vec![Some(f64::NAN), Some(1.0)],
            vec![Some(5.0); 300],
        ] {
            let x = axis(values.len());
            for svg in [
                stacked(hostile, &x, hostile, &series(values.clone())),
                lines(hostile, &x, hostile, &series(values.clone()), false),
                lying(hostile, hostile, hostile, &[(hostile.into(), 3.0, BAD)]),
            ] {
                let text = svg.as_str();
                assert!(!text.contains("<script") && !text.contains('\u{0}'));
                assert!(!text.contains("NaN") || values.iter().flatten().any(|v| v.is_nan()));
                let opened = text.matches("<text").count();
                assert_eq!(opened, text.matches("</text>").count());
            }
        }
    }
}
