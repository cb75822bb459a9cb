//! Logs and progress. Libraries report progress as tracing events of the target [`PROGRESS`] with `phase`, `done`, `total` and `eta_ms`. A
//! terminal shows a bar; other processes get JSON lines.

use crate::output::eprintln;
use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use std::collections::HashMap;
use std::io::IsTerminal;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use tracing::field::{Field, Visit};
use tracing::{Event, Subscriber};
use tracing_subscriber::filter::{filter_fn, FilterExt};
use tracing_subscriber::layer::{Context, SubscriberExt};
use tracing_subscriber::registry::LookupSpan;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer, Registry};

/// Target of progress events.
pub const PROGRESS: &str = "zk0::progress";

/// How a process writes its log.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum LogFormat {
    /// Text for people.
    #[default]
    Text,
    /// One JSON object per line.
    Json,
}

/// Logs to standard error, at the level of `RUST_LOG`. `traces` gets our spans, which the log leaves out.
pub fn init(format: LogFormat, traces: Option<impl Layer<Registry> + Send + Sync>) {
    let filter = || {
        let levels = EnvFilter::try_from_default_env();
        let levels = levels.unwrap_or_else(|_| EnvFilter::new("warn,zk0=info"));
        levels.and(filter_fn(|meta| {
            meta.is_event() || !meta.target().starts_with("zk0")
        }))
    };
    let registry = tracing_subscriber::registry().with(traces);
    // Files and journals keep colour codes.
    let terminal = std::io::stderr().is_terminal();
    let coloured = terminal && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
    match format {
        LogFormat::Json => registry
            .with(
                tracing_subscriber::fmt::layer()
                    .json()
                    .flatten_event(true)
                    .with_writer(std::io::stderr)
                    .with_filter(filter()),
            )
            .init(),
        LogFormat::Text => registry
            .with(
                tracing_subscriber::fmt::layer()
                    .with_target(false)
                    .with_ansi(coloured)
                    .with_writer(std::io::stderr)
                    .with_filter(filter_fn(|meta| meta.target() != PROGRESS))
                    .with_filter(filter()),
            )
            .with(terminal.then(|| BarLayer(ProgressBars::default())))
            .init(),
    }
}

/// An error and its causes, as `{:#}`, without repetitions: many errors contain their cause.
pub fn with_causes(error: &anyhow::Error) -> String {
    let mut reported = String::new();
    for cause in error.chain().map(ToString::to_string) {
        match reported.as_str() {
            "" => reported = cause,
            so_far if so_far.contains(&cause) => {}
            _ => reported = format!("{reported}: {cause}"),
        }
    }
    reported
}

/// One progress event.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Deserialize)]
pub struct ProgressEvent {
    /// The work: `training`, `proving` and so on.
    pub phase: String,
    /// Units done.
    pub done: u64,
    /// Units in all.
    pub total: u64,
    /// Estimated time left, in milliseconds.
    #[serde(default)]
    pub eta_ms: Option<u64>,
}

impl Visit for ProgressEvent {
    fn record_u64(&mut self, field: &Field, value: u64) {
        match field.name() {
            "done" => self.done = value,
            "total" => self.total = value,
            "eta_ms" => self.eta_ms = Some(value),
            _ => {}
        }
    }

    fn record_str(&mut self, field: &Field, value: &str) {
        if field.name() == "phase" {
            self.phase = value.into();
        }
    }

    fn record_debug(&mut self, _: &Field, _: &dyn std::fmt::Debug) {}
}

/// Progress bars by key, drawn together.
#[derive(Debug, Default)]
pub struct ProgressBars {
    all: MultiProgress,
    by_key: Mutex<HashMap<String, ProgressBar>>,
}

impl ProgressBars {
    /// Draws the bar of `key`. A finished bar disappears.
    pub fn show(&self, key: &str, progress: &ProgressEvent) {
        let mut bars = self.by_key.lock().unwrap_or_else(PoisonError::into_inner);
        if progress.done >= progress.total {
            if let Some(bar) = bars.remove(key) {
                bar.finish_and_clear();
            }
            return;
        }
        let bar = bars.entry(key.into()).or_insert_with(|| {
            let style = ProgressStyle::with_template("{prefix:>22} [{bar:30}] {percent:>3}% {msg}")
                .unwrap_or_else(|_| ProgressStyle::default_bar());
            self.all.add(
                ProgressBar::new(progress.total)
                    .with_style(style)
                    .with_prefix(key.to_owned()),
            )
        });
        bar.set_length(progress.total);
        bar.set_position(progress.done);
        bar.set_message(
            progress
                .eta_ms
                .map(|ms| format!("about {} left", minutes(ms)))
                .unwrap_or_default(),
        );
    }

    /// Prints a line above the bars.
    pub fn line(&self, text: &str) {
        if std::io::stderr().is_terminal() {
            let _ = self.all.println(text);
        } else {
            eprintln!("{text}");
        }
    }
}

/// `90 s` or `12 min`.
pub fn minutes(ms: u64) -> String {
    match Duration::from_millis(ms).as_secs() {
        seconds if seconds < 120 => format!("{seconds} s"),
        seconds => format!("{} min", seconds.div_ceil(60)),
    }
}

struct BarLayer(ProgressBars);

impl<S: Subscriber + for<'a> LookupSpan<'a>> Layer<S> for BarLayer {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        if event.metadata().target() == PROGRESS {
            let mut progress = ProgressEvent::default();
            event.record(&mut progress);
            self.0.show(&progress.phase.clone(), &progress);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::Context;

    #[test]
    fn no_cause_is_said_twice() {
        let refused = || Err::<(), _>(std::io::Error::other("refused"));
        let once = "joining: the service cannot be reached: refused; start it";
        let error = refused().context("the service cannot be reached: refused; start it");
        let error = error.context("joining").unwrap_err();
        assert_eq!(with_causes(&error), once);
        assert_ne!(format!("{error:#}"), once);
        let error = refused().context("reading it").unwrap_err();
        assert_eq!(with_causes(&error), "reading it: refused");
    }
}
