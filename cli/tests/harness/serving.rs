//! A process that serves, ended when it is dropped.

use super::zk0;
use std::ffi::OsStr;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{channel, Receiver, RecvTimeoutError};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;
use zk0_testkit::until;

/// A serving process.
pub struct Serving {
    process: Child,
    log: Arc<Mutex<String>>,
    /// Disconnected when the log ends, and with it the process.
    ended: Receiver<()>,
    /// The address that it serves on.
    pub address: String,
}

impl Serving {
    /// Starts the binary, and waits until it states where it listens.
    pub fn start(arguments: &[&str]) -> Self {
        Self::start_with(arguments, &[] as &[(&str, &str)])
    }

    /// Like [`Self::start`], with these environment variables.
    pub fn start_with(
        arguments: &[&str],
        variables: &[(impl AsRef<OsStr>, impl AsRef<OsStr>)],
    ) -> Self {
        let mut command = zk0(&["--log", "json"]);
        command.args(arguments);
        command.envs(variables.iter().map(|(name, value)| (name, value)));
        Self::of(command)
    }

    /// Starts a command that runs the binary with a log of JSON lines, and waits until it states where it listens.
    pub fn of(mut command: Command) -> Self {
        let mut process = command.stderr(Stdio::piped()).spawn().unwrap();
        let mut log = BufReader::new(process.stderr.take().unwrap());
        let address = (&mut log)
            .lines()
            .map_while(Result::ok)
            .find_map(|line| {
                let line: serde_json::Value = serde_json::from_str(&line).ok()?;
                Some(line["listening"].as_str()?.to_owned())
            })
            .expect("it states where it listens");
        // It goes on to write its log.
        let written = Arc::new(Mutex::new(String::new()));
        let more = written.clone();
        let (running, ended) = channel();
        thread::spawn(move || {
            let _running = running;
            for line in log.lines().map_while(Result::ok) {
                *more.lock().unwrap() += &(line + "\n");
            }
        });
        Self {
            process,
            log: written,
            ended,
            address: format!("http://{address}"),
        }
    }

    /// Tells the process to end, and waits until it has.
    pub fn terminate(&mut self) -> ExitStatus {
        self.told_to_end();
        self.process.wait().unwrap()
    }

    /// Tells the process to end.
    pub fn told_to_end(&self) {
        let pid = self.process.id().to_string();
        let told = Command::new("kill").args(["-TERM", &pid]).status();
        assert!(told.unwrap().success());
    }
}

impl Serving {
    /// Its log so far, from the line after the one that states where it listens.
    pub fn log(&self) -> String {
        self.log.lock().unwrap().clone()
    }

    /// Waits until its log holds these words.
    #[track_caller]
    pub fn logs(&self, words: &str) {
        until(format!("{words:?} is logged"), || {
            self.log().contains(words)
        });
    }

    /// Kills the process, as the system does when memory is short.
    pub fn kill(&mut self) {
        self.process.kill().unwrap();
        self.process.wait().unwrap();
    }

    /// How the process ended, if it does so by itself in this time.
    pub fn ended_within(&mut self, time: Duration) -> Option<ExitStatus> {
        match self.ended.recv_timeout(time) {
            Err(RecvTimeoutError::Disconnected) => Some(self.process.wait().unwrap()),
            _ => None,
        }
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        if thread::panicking() {
            eprintln!("{}", self.log());
        }
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
