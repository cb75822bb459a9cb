//! A process that serves, ended when it is dropped.

use super::zk0;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// A serving process.
pub struct Serving {
    process: Child,
    /// The address that it serves on.
    pub address: String,
}

impl Serving {
    /// Starts the binary, and waits until it says where it listens.
    pub fn start(arguments: &[&str]) -> Self {
        let mut process = zk0(&["--log", "json"])
            .args(arguments)
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut log = BufReader::new(process.stderr.take().unwrap());
        let address = (&mut log)
            .lines()
            .map_while(Result::ok)
            .find_map(|line| {
                let line: serde_json::Value = serde_json::from_str(&line).ok()?;
                Some(line["listening"].as_str()?.to_owned())
            })
            .expect("it says where it listens");
        // It goes on to write its log.
        std::thread::spawn(move || std::io::copy(&mut log, &mut std::io::sink()));
        let address = format!("http://{address}");
        Self { process, address }
    }

    /// Tells the process to end, and waits until it has.
    pub fn terminate(&mut self) -> ExitStatus {
        let pid = self.process.id().to_string();
        let told = Command::new("kill").args(["-TERM", &pid]).status();
        assert!(told.unwrap().success());
        self.process.wait().unwrap()
    }
}

impl Serving {
    /// Kills the process, as the system does when memory is short.
    pub fn kill(&mut self) {
        self.process.kill().unwrap();
        self.process.wait().unwrap();
    }

    /// How the process ended, if it does so by itself in this time.
    pub fn ended_within(&mut self, time: Duration) -> Option<ExitStatus> {
        let begun = Instant::now();
        while begun.elapsed() < time {
            if let Some(status) = self.process.try_wait().unwrap() {
                return Some(status);
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        None
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
