//! A process of the binary that a test kills, or cuts off. It is followed by its log.

use super::{words, zk0};
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{channel, Receiver, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

/// How long anything may take here. A busy machine needs a minute for a round.
const PATIENCE: Duration = Duration::from_secs(400);

/// A process that is killed when it is dropped, and the lines of its log.
pub struct Process {
    child: Child,
    log: Receiver<Value>,
}

impl Process {
    /// Starts the binary.
    pub fn start(arguments: &[String]) -> Self {
        let mut command = zk0(&["--log", "json"]);
        command.args(words(arguments));
        Self::of(command)
    }

    /// Starts a command that runs the binary with `--log json`.
    pub fn of(mut command: Command) -> Self {
        let mut child = command.stderr(Stdio::piped()).spawn().unwrap();
        let lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let (sender, log) = channel();
        thread::spawn(move || {
            for line in lines.map_while(Result::ok) {
                let Ok(line) = serde_json::from_str(&line) else {
                    continue;
                };
                if sender.send(line).is_err() {
                    break;
                }
            }
        });
        Self { child, log }
    }

    /// Waits until the log has a line whose message begins with this, and returns it.
    pub fn reports(&self, message: &str) -> Value {
        self.says_one_of(&[message])
    }

    /// Waits until the log has a line whose message begins with one of these, and returns it.
    pub fn says_one_of(&self, messages: &[&str]) -> Value {
        let until = Instant::now() + PATIENCE;
        loop {
            let line = self.line(until);
            let line = line.unwrap_or_else(|error| panic!("no log states {messages:?}: {error}"));
            let reported = line["message"].as_str().unwrap_or_default();
            if messages.iter().any(|begin| reported.starts_with(begin)) {
                return line;
            }
        }
    }

    /// The next line of the log, which may take until then.
    fn line(&self, until: Instant) -> Result<Value, RecvTimeoutError> {
        let left = until.saturating_duration_since(Instant::now());
        self.log.recv_timeout(left)
    }

    /// Waits until the process serves, and returns its address.
    pub fn address(&self) -> String {
        let listening = self.reports("the aggregator of network");
        listening["listening"].as_str().unwrap().to_owned()
    }

    /// The process gets no time to end its work.
    pub fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Tells the process to end, and waits until it has.
    pub fn terminate(&mut self) {
        let pid = self.child.id().to_string();
        let told = Command::new("kill").args(["-TERM", &pid]).status();
        assert!(told.unwrap().success());
        self.ends();
    }

    /// Waits until the process has ended by itself, with success.
    pub fn ends(&mut self) {
        let until = Instant::now() + PATIENCE;
        let mut reported = vec![];
        let ended = loop {
            match self.line(until) {
                Ok(line) => reported.push(line.to_string()),
                Err(ended) => break ended,
            }
        };
        let reported = reported.join("\n");
        // The log ends with the process.
        assert_eq!(ended, RecvTimeoutError::Disconnected, "{reported}");
        assert!(self.child.wait().unwrap().success(), "{reported}");
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
