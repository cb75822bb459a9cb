//! `zk0 audit watch`: an audit that does not end. What was seen once has to stay: a log that forks, goes back or breaks a rule
//! ends it, loudly.

use super::{replay::Bar, show};
use crate::ledger::TrustOptions;
use anyhow::{bail, Result};
use serde_json::json;
use std::{io::Write, path::PathBuf, thread::sleep, time::Duration};
use zk0_audit::{
    report::describe::printable,
    watch::{Look, Seen, Watch, WatchOptions},
    Depth,
};

/// `zk0 audit watch`.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// A ledger's directory, an export of one, or the address of a served log.
    ledger: String,
    /// Seconds between two looks.
    #[arg(long, value_name = "SECONDS", default_value_t = 60)]
    interval: u64,
    /// Look so often, then end; without it, for ever.
    #[arg(long, value_name = "TIMES")]
    looks: Option<u64>,
    /// Remember in this file what was seen, so that after a restart a fork or a rollback is still noticed, and only what is new is
    /// read.
    #[arg(long, value_name = "FILE")]
    state: Option<PathBuf>,
    /// Keep what is fetched in this directory; only what is new is fetched after a restart.
    #[arg(long, value_name = "DIR")]
    mirror: Option<PathBuf>,
    /// Read no weights, and fetch none: see `replay`.
    #[arg(long)]
    light: bool,
    /// Print JSON lines.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    trust: TrustOptions,
}

/// How many looks in a row may fail for want of an answer, or of a file that is about to come.
const PATIENCE: u32 = 5;

/// Runs it; `false` when something is wrong with the log.
pub fn run(options: &Options) -> Result<bool> {
    let watch = Watch::begin(WatchOptions {
        ledger: options.ledger.clone(),
        trust: options.trust.read()?,
        depth: match options.light {
            true => Depth::Light,
            false => Depth::Full,
        },
        state: options.state.clone(),
        mirror: options.mirror.clone(),
    })?;
    let mut failed = 0;
    let mut look = 0;
    loop {
        let bar = Bar::default();
        let progress = |done, total| bar.at(done, total);
        let progress = (!options.json).then_some(&progress as &(dyn Fn(u64, u64) + Sync));
        match watch.look(progress, |seen| options.tell(seen)) {
            Ok(Look::Continues) => failed = 0,
            Ok(Look::Alarm(why)) => {
                options.say("ALARM", &why);
                return Ok(false);
            }
            Err(error) => {
                failed += 1;
                tracing::warn!("look {failed} of {PATIENCE} got no answer: {error:#}");
                if failed == PATIENCE {
                    return Err(error.context(format!("{} gives no answer", options.ledger)));
                }
            }
        }
        look += 1;
        if options.looks == Some(look) {
            // What was never seen is not verified.
            if failed > 0 {
                bail!("{} gave no answer at the last look", options.ledger);
            }
            return Ok(true);
        }
        sleep(Duration::from_secs(options.interval));
    }
}

impl Options {
    fn tell(&self, seen: Seen<'_>) {
        match seen {
            Seen::First { entries, network } => {
                self.say(
                    "verified",
                    &format!("{entries} entries of network {network}"),
                );
            }
            Seen::New { index, entry } => {
                match self.json {
                    true => println!("{}", show::as_json(index, entry)),
                    false => println!("{}", show::line(index, entry)),
                }
                let _ = std::io::stdout().flush();
            }
        }
    }

    fn say(&self, label: &str, text: &str) {
        let text = printable(text);
        match self.json {
            true => println!("{}", json!({ "event": label.to_lowercase(), "text": text })),
            false => println!("{label:<12} {text}"),
        }
        let _ = std::io::stdout().flush();
    }
}
