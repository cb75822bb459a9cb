//! The commands of our pages. [`understood`]: the program knows all of them. The others follow a page as a [`Reader`] does, with its commands as they
//! stand there.

mod auditor;
mod governors;
mod node;
mod operator;
mod understood;

use crate::harness::serving::Serving;
use crate::harness::{ends, json, printed, root, text};
use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;
use zk0_testkit::pages::commands;

/// The id of the network of this ledger.
fn network_of(ledger: &Path) -> String {
    let shown = json(&["audit", "show", text(ledger), "--json"]);
    shown["network"]["id"].as_str().unwrap().to_owned()
}

/// Somebody who follows pages in a folder of their own.
pub struct Reader {
    folder: TempDir,
    /// Words of the pages, and what this reader writes in their place.
    filled_in: Vec<(&'static str, String)>,
}

impl Reader {
    pub fn new() -> Self {
        Self {
            folder: tempfile::tempdir().unwrap(),
            filled_in: Vec::new(),
        }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes `value` in the place of these words from now on.
    pub fn fills_in(&mut self, words: &'static str, value: impl Into<String>) {
        self.filled_in.retain(|(other, _)| *other != words);
        self.filled_in.push((words, value.into()));
    }

    /// The shortest command of a page that begins so.
    #[track_caller]
    pub fn on_page(page: &str, begin: &str) -> String {
        let commands = commands(&fs::read_to_string(root().join(page)).unwrap()).into_iter();
        commands
            .filter(|command| command.starts_with(begin))
            .min_by_key(String::len)
            .unwrap_or_else(|| panic!("{page} has no command that begins with {begin:?}"))
    }

    /// This command, in the reader's folder. A service that is not told where to listen takes a free port.
    pub fn types(&self, command: String) -> Command {
        let fill_in =
            |command: String, (words, value): &(&str, String)| command.replace(*words, value);
        let command = self.filled_in.iter().fold(command, fill_in);
        let program = Path::new(env!("CARGO_BIN_EXE_zk0")).parent().unwrap();
        let path = format!("{}:{}", text(program), env::var("PATH").unwrap());
        let mut shell = Command::new("bash");
        shell.args(["-c", &format!("exec {command}")]);
        shell.current_dir(self.folder.path());
        shell.env("PATH", path).env("ZK0_LOG", "json");
        shell.env("ZK0_LEDGER_LISTEN", "127.0.0.1:0");
        shell
    }

    #[track_caller]
    fn command(&self, page: &str, begin: &str) -> Command {
        self.types(Self::on_page(page, begin))
    }

    /// Runs such a command, which has to succeed. Returns what it prints.
    #[track_caller]
    fn follows(&self, page: &str, begin: &str) -> String {
        printed(&ends(0, self.command(page, begin)))
    }

    /// Starts such a command, which serves until it is dropped.
    #[track_caller]
    fn serves(&self, page: &str, begin: &str) -> Serving {
        Serving::of(self.command(page, begin))
    }
}
