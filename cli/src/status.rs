//! `zk0 status`: an aggregator's state. Trouble gives exit code 3.

use crate::keys;
use crate::network::NetworkChoice;
use anyhow::{Context, Result};
use ed25519_dalek::SigningKey;
use serde::Serialize;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::process::ExitCode;
use std::time::Duration;
use tokio::time::sleep;
use zk0_circuits::Digest;
use zk0_node::client::carried::carried;
use zk0_node::client::status::RoundWatch;
use zk0_node::client::NodeClient;
use zk0_protocol::counted::counted;
use zk0_protocol::rpc::federation::status_info::Phase;
use zk0_protocol::rpc::federation::{StatusInfo, Trouble};

/// `zk0 status`.
#[derive(Debug, clap::Args)]
pub struct StatusOptions {
    #[command(flatten)]
    network: NetworkChoice,
    /// Show the status again whenever the round comes further, and every two seconds, until you press Ctrl-C.
    #[arg(long)]
    watch: bool,
    /// Print one JSON object; with --watch, one a line.
    #[arg(long)]
    json: bool,
}

/// Between requests with `--watch`.
const REFRESH: Duration = Duration::from_secs(2);

const TROUBLE: u8 = 3;

/// Runs the command. Its exit code is the last status's.
pub async fn run(options: &StatusOptions) -> Result<ExitCode> {
    // Nothing is signed, so any key will do.
    let key = SigningKey::from_bytes(&keys::random()?);
    let mut node = options.network.connect(key.clone()).await?;
    let status = StatusView::ask(&mut node).await?;
    if !options.write(&status)? || !options.watch {
        return Ok(status.code());
    }
    // Its own connection can wait.
    let mut follower = options.network.connect(key).await?;
    let (mut watch, mut silent) = (RoundWatch::default(), false);
    loop {
        tokio::select! {
            changed = follower.changed(&mut watch) => changed?,
            () = sleep(REFRESH) => {}
        }
        match StatusView::ask(&mut node).await {
            Ok(status) => {
                silent = false;
                if !options.write(&status)? {
                    return Ok(status.code());
                }
            }
            // It may be starting again.
            Err(error) if !silent => {
                tracing::warn!("{error:#}; the aggregator is asked again every {REFRESH:?}");
                silent = true;
            }
            Err(_) => {}
        }
    }
}

impl StatusOptions {
    /// Returns `false` if the reader, such as `head`, has left.
    fn write(&self, status: &StatusView) -> Result<bool> {
        let mut text = if self.json {
            serde_json::to_string(&status.facts())? + "\n"
        } else {
            status.text()
        };
        let mut out = io::stdout().lock();
        // A terminal shows only the newest.
        if !self.json && self.watch && out.is_terminal() {
            text.insert_str(0, "\x1b[H\x1b[2J");
        }
        match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
            Ok(()) => Ok(true),
            Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(false),
            Err(error) => Err(error).context("writing to standard output"),
        }
    }
}

struct StatusView {
    network: Digest,
    name: String,
    /// Its number of entries.
    checkpoint: u64,
    /// The guest programs of this release.
    carried: Vec<String>,
    now: StatusInfo,
}

/// Times are milliseconds; moments are Unix times on the aggregator's clock.
#[derive(Serialize)]
struct Facts {
    network: String,
    name: String,
    now_ms: u64,
    uptime_ms: u64,
    round: u64,
    phase: &'static str,
    deadline_ms: Option<u64>,
    ends_by_ms: Option<u64>,
    committed: u64,
    accepted: u64,
    refused: u64,
    enrolled: u64,
    ready: u64,
    needed: u64,
    rounds: Option<u64>,
    last_round_ms: Option<u64>,
    left_ms: Option<u64>,
    entries: u64,
    published: u64,
    last_entry_ms: u64,
    checkpoint: u64,
    verifying: u64,
    waiting_to_verify: u64,
    verification_ms: u64,
    disk_free_percent: Option<u32>,
    blob_store_failing_ms: Option<u64>,
    backup_ms: Option<u64>,
    backup_entries: Option<u64>,
    backup_lacks_since_ms: Option<u64>,
    program: String,
    trouble: Vec<TroubleFacts>,
}

#[derive(Serialize)]
struct TroubleFacts {
    kind: &'static str,
    sentence: String,
    for_ms: u64,
}

impl From<&Trouble> for TroubleFacts {
    fn from(trouble: &Trouble) -> Self {
        Self {
            kind: trouble.kind().name(),
            sentence: trouble.sentence.clone(),
            for_ms: trouble.for_ms,
        }
    }
}

impl StatusView {
    async fn ask(node: &mut NodeClient) -> Result<Self> {
        Ok(Self {
            network: *node.network(),
            name: node.genesis().name.clone(),
            checkpoint: node.checkpoint().await?.size,
            carried: carried(node.genesis().mode)
                .iter()
                .map(ToString::to_string)
                .collect(),
            now: node.status().await?,
        })
    }

    fn code(&self) -> ExitCode {
        if self.now.trouble.is_empty() {
            ExitCode::SUCCESS
        } else {
            ExitCode::from(TROUBLE)
        }
    }

    fn facts(&self) -> Facts {
        let now = &self.now;
        let known = |moment: u64| Some(moment).filter(|moment| *moment > 0);
        Facts {
            network: self.network.to_string(),
            name: self.name.clone(),
            now_ms: now.now_ms,
            uptime_ms: now.uptime_ms,
            round: now.round,
            phase: now.phase().name(),
            deadline_ms: known(now.deadline_ms),
            ends_by_ms: known(now.ends_by_ms),
            committed: now.committed,
            accepted: now.accepted,
            refused: now.refused,
            enrolled: now.enrolled,
            ready: now.ready,
            needed: now.needed,
            rounds: now.rounds,
            last_round_ms: now.last_round_ms,
            left_ms: left_ms(now),
            entries: now.entries,
            published: now.published,
            last_entry_ms: now.last_entry_ms,
            checkpoint: self.checkpoint,
            verifying: now.verifying,
            waiting_to_verify: now.waiting_to_verify,
            verification_ms: now.verification_ms,
            disk_free_percent: now.disk_free_percent,
            blob_store_failing_ms: now.blob_store_failing_ms,
            backup_ms: now.backup_ms,
            backup_entries: now.backup_entries,
            backup_lacks_since_ms: now.backup_lacks_since_ms,
            program: now.program.clone(),
            trouble: now.trouble.iter().map(TroubleFacts::from).collect(),
        }
    }

    fn text(&self) -> String {
        let now = &self.now;
        let mut lines = vec![
            // The aggregator chose the name.
            format!(
                "network      {} ({})",
                self.network,
                self.name.escape_debug()
            ),
            format!("aggregator   up for {}", duration(now.uptime_ms)),
            format!(
                "round {:<6} {}: {}",
                now.round,
                now.phase().name(),
                phase_text(now)
            ),
        ];
        // The aggregator chose the sentences, too.
        let troubles = now.trouble.iter().map(|trouble| {
            format!(
                "trouble      {}, for {}: {}",
                trouble.kind().name(),
                duration(trouble.for_ms),
                trouble.sentence.escape_debug()
            )
        });
        lines.splice(1..1, troubles);
        if now.phase() != Phase::Waiting {
            lines.push(format!(
                "             {} committed, {} accepted, {} refused",
                now.committed, now.accepted, now.refused
            ));
            if now.ends_by_ms > 0 {
                lines.push(format!(
                    "             it ends in at most {}",
                    until(now, now.ends_by_ms)
                ));
            }
        }
        if let Some(rounds) = now.rounds {
            let done = now.round.min(rounds);
            let left = left_ms(now).map_or(String::new(), |left| {
                format!(
                    "; about {} left, if each takes as long as the last one",
                    duration(left)
                )
            });
            lines.push(format!("rounds       {done} of {rounds} are over{left}"));
        }
        lines.push(format!(
            "nodes        {} enrolled, {} ready; a round needs {}",
            now.enrolled, now.ready, now.needed
        ));
        lines.push(self.program_text());
        let wait = now.waiting_to_verify.saturating_mul(now.verification_ms) / now.verifying.max(1);
        lines.push(format!(
            "queue        {} verifications run, {} wait (about {})",
            now.verifying,
            now.waiting_to_verify,
            duration(wait)
        ));
        lines.push(format!(
            "ledger       {} entries, the last one {} ago; the newest checkpoint covers {}",
            now.entries,
            duration(now.now_ms.saturating_sub(now.last_entry_ms)),
            self.checkpoint
        ));
        lines.push(match now.disk_free_percent {
            Some(percent) => format!("disk         {percent} % free"),
            None => "disk         the system does not state how full it is".into(),
        });
        lines.push(match now.backup_ms.zip(now.backup_entries) {
            Some((_, entries)) if entries > now.entries => format!(
                "backup       it has {} that the ledger lacks: the ledger was rolled back",
                counted(entries - now.entries, "entry", "entries")
            ),
            Some((finished_ms, entries)) => format!(
                "backup       {} old; the ledger has {} that it lacks",
                duration(now.now_ms.saturating_sub(finished_ms)),
                counted(now.entries - entries, "entry", "entries")
            ),
            None => "backup       none yet".into(),
        });
        match now.blob_store_failing_ms {
            None => {}
            Some(0) => lines.push("blob store   answered last time".into()),
            Some(ms) => lines.push(format!(
                "blob store   has failed for {}; the aggregator's log states why",
                duration(ms)
            )),
        }
        lines.join("\n") + "\n"
    }
}

impl StatusView {
    /// The guest program, and whether nodes of this release have it.
    fn program_text(&self) -> String {
        // The aggregator chose it.
        let program = self.now.program.escape_debug();
        if self.carried.contains(&self.now.program) {
            format!("program      {program}")
        } else {
            let own = self.carried.join(" or ");
            format!("program      {program}, which this release lacks: its nodes wait for a vote for {own}, or for another release")
        }
    }
}

fn phase_text(now: &StatusInfo) -> String {
    let left = until(now, now.deadline_ms);
    match now.phase() {
        Phase::Unspecified => "this release of zk0 does not know the phase".into(),
        Phase::Waiting if now.ready < now.needed => "it waits for nodes".into(),
        Phase::Waiting => "it is not open yet".into(),
        Phase::Committing if now.deadline_ms > now.now_ms => {
            format!("it takes commitments for another {left}")
        }
        Phase::Committing => "it closes its commitments".into(),
        Phase::Drawing => "it waits for its randomness".into(),
        Phase::Submitting => format!("it takes submissions for another {left}"),
        Phase::Closing => "what arrived in time is decided, and its end is recorded".into(),
    }
}

/// Assumes that rounds take as long as the last one; `None` if unknown.
fn left_ms(now: &StatusInfo) -> Option<u64> {
    let left = now.rounds?.saturating_sub(now.round);
    Some(left.saturating_mul(now.last_round_ms?))
}

fn until(now: &StatusInfo, moment: u64) -> String {
    duration(moment.saturating_sub(now.now_ms))
}

/// `45 s`, `12 min 3 s`, `7 h 20 min`, `2 d 3 h`.
fn duration(ms: u64) -> String {
    let (s, min, h) = (ms / 1000, ms / 60_000, ms / 3_600_000);
    match h {
        0 if min == 0 => format!("{s} s"),
        0 => format!("{min} min {} s", s % 60),
        1..48 => format!("{h} h {} min", min % 60),
        _ => format!("{} d {} h", h / 24, h % 24),
    }
}
