//! The demo's child processes. Each runs this binary. Its JSON log goes to one file and the screen.

use crate::logging::{ProgressBars, ProgressEvent, PROGRESS};
use anyhow::{bail, Context, Result};
use serde_json::{Map, Value};
use std::ffi::OsStr;
use std::fs::File;
use std::io::Write;
use std::process::Stdio;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;
use tokio::io::{AsyncBufReadExt, BufReader};
use tokio::process::{Child, Command};
use tokio::sync::watch;

/// The log file and the screen.
#[derive(Clone, Debug)]
pub struct Console(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    log: Mutex<File>,
    bars: ProgressBars,
    started: Instant,
}

impl Console {
    /// Writes the log to `log`.
    pub fn new(log: File) -> Self {
        Self(Arc::new(Inner {
            log: Mutex::new(log),
            bars: ProgressBars::default(),
            started: Instant::now(),
        }))
    }

    /// Writes a line of the demo itself.
    pub fn tell(&self, text: &str) {
        let mut line = Map::new();
        line.insert("message".into(), text.into());
        self.record("demo", line);
        self.print("demo", text);
    }

    fn print(&self, process: &str, text: &str) {
        let seconds = self.0.started.elapsed().as_secs();
        self.0.bars.line(&format!(
            "{:>3}:{:02} {process:>11}  {text}",
            seconds / 60,
            seconds % 60
        ));
    }

    fn record(&self, process: &str, mut line: Map<String, Value>) {
        line.insert("process".into(), process.into());
        let mut log = self.0.log.lock().unwrap_or_else(PoisonError::into_inner);
        // A full disk must not end the demo.
        let _ = writeln!(log, "{}", Value::Object(line));
    }

    fn child_line(&self, process: &str, line: &str, last_progress: &mut (String, u64)) {
        let Ok(Value::Object(fields)) = serde_json::from_str(line) else {
            // A panic, or a library's message.
            self.record(
                process,
                Map::from_iter([("message".to_owned(), line.into())]),
            );
            return self.print(process, line);
        };
        if fields.get("target").and_then(Value::as_str) == Some(PROGRESS) {
            if let Ok(progress) =
                serde_json::from_value::<ProgressEvent>(Value::Object(fields.clone()))
            {
                self.progress(process, &progress, last_progress);
            }
        } else if let Some(message) = fields.get("message").and_then(Value::as_str) {
            self.print(process, &format!("{message}{}", details(&fields)));
        }
        self.record(process, fields);
    }

    fn progress(&self, process: &str, progress: &ProgressEvent, last: &mut (String, u64)) {
        use std::io::IsTerminal;
        if std::io::stderr().is_terminal() {
            return self
                .0
                .bars
                .show(&format!("{process} {}", progress.phase), progress);
        }
        let tenth = progress.done.saturating_mul(10) / progress.total.max(1);
        if *last != (progress.phase.clone(), tenth) {
            *last = (progress.phase.clone(), tenth);
            let eta = progress
                .eta_ms
                .map(|ms| format!(", about {} left", crate::logging::minutes(ms)));
            self.print(
                process,
                &format!(
                    "{} {} %{}",
                    progress.phase,
                    tenth * 10,
                    eta.unwrap_or_default()
                ),
            );
        }
    }
}

/// A child process.
#[derive(Debug)]
pub struct ChildProcess {
    name: String,
    child: Child,
    listening: watch::Receiver<Option<String>>,
}

impl ChildProcess {
    /// Starts this binary. An option without a name is an argument. A drop kills the process.
    pub fn start(
        name: &str,
        command: &str,
        options: &[(&str, &dyn AsRef<OsStr>)],
        console: &Console,
    ) -> Result<Self> {
        let binary = std::env::current_exe().context("finding this program's file")?;
        let mut child = Command::new(binary)
            .args(["--log", "json"])
            .args(command.split(' '))
            .args(options.iter().flat_map(|(name, value)| {
                let name = Some(OsStr::new(*name)).filter(|name| !name.is_empty());
                name.into_iter().chain([value.as_ref()])
            }))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .kill_on_drop(true)
            .spawn()
            .with_context(|| format!("starting {name}"))?;
        let stderr = child
            .stderr
            .take()
            .context("the child has no standard error")?;
        let (told, listening) = watch::channel(None);
        let (process, console) = (name.to_owned(), console.clone());
        tokio::spawn(async move {
            let (mut lines, mut last) = (BufReader::new(stderr).lines(), Default::default());
            while let Ok(Some(line)) = lines.next_line().await {
                if let Some(address) = listening_address(&line) {
                    told.send_replace(Some(address));
                }
                console.child_line(&process, &line, &mut last);
            }
        });
        Ok(Self {
            name: name.into(),
            child,
            listening,
        })
    }

    /// The address where it listens.
    pub async fn address(&mut self) -> Result<String> {
        let told = self
            .listening
            .wait_for(Option::is_some)
            .await
            .map(|address| address.clone());
        match told {
            Ok(Some(address)) => Ok(address),
            _ => bail!(
                "{} ended before it listened; its last log lines above state why",
                self.name
            ),
        }
    }

    /// Waits for success.
    pub async fn finish(&mut self) -> Result<()> {
        let status = self
            .child
            .wait()
            .await
            .with_context(|| format!("waiting for {}", self.name))?;
        if !status.success() {
            bail!(
                "{} ended with {status}; its last log lines above state why",
                self.name
            );
        }
        Ok(())
    }

    /// Waits for the end, which is an error of a server.
    pub async fn ended(&mut self) -> anyhow::Error {
        match self.child.wait().await {
            Ok(status) => anyhow::anyhow!(
                "{} ended too early with {status}; its last log lines above state why",
                self.name
            ),
            Err(error) => anyhow::Error::from(error).context(format!("waiting for {}", self.name)),
        }
    }

    /// Ends the process. What servers acknowledged is on disk.
    pub async fn stop(mut self) {
        let _ = self.child.kill().await;
    }
}

/// Only the log file has whole digests.
fn details(fields: &Map<String, Value>) -> String {
    const KNOWN: [&str; 5] = ["timestamp", "level", "target", "message", "listening"];
    let short = |value: &Value| {
        let text = value
            .as_str()
            .map_or_else(|| value.to_string(), str::to_owned);
        let digest = text.len() == 64 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
        if digest {
            format!("{}…", &text[..12])
        } else {
            text
        }
    };
    let named: Vec<_> = fields
        .iter()
        .filter(|(name, _)| !KNOWN.contains(&name.as_str()))
        .map(|(name, value)| format!("{name} {}", short(value)))
        .collect();
    if named.is_empty() {
        String::new()
    } else {
        format!(" ({})", named.join(", "))
    }
}

/// Servers log their address as `listening`.
fn listening_address(line: &str) -> Option<String> {
    let fields: Map<String, Value> = serde_json::from_str(line).ok()?;
    Some(fields.get("listening")?.as_str()?.to_owned())
}
