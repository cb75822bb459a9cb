//! What a drill prints. A drill plays an event that happens to a network once in months. `make drills` plays all of them.

use super::root;
use serde_json::json;
use std::fs;
use std::time::Instant;

/// The events, and the tests that play them.
const TABLE: &str = include_str!("../../../testkit/tests/drills.txt");

/// An event that has happened.
pub struct Drill {
    event: &'static str,
    since: Instant,
    /// The commands of `docs/runbook.md` that people type.
    pub typed: Vec<String>,
    /// What is lost for good.
    pub lost: &'static str,
    /// Which times are shorter here than in life.
    pub shortened: Option<&'static str>,
}

impl Drill {
    /// This event of the table happens now.
    #[track_caller]
    pub fn begin(event: &'static str) -> Self {
        let mut events = TABLE.lines().filter_map(|row| row.split(" | ").next());
        assert!(
            events.any(|known| known == event),
            "{event:?} is not in testkit/tests/drills.txt"
        );
        Self {
            event,
            since: Instant::now(),
            typed: Vec::new(),
            lost: "nothing",
            shortened: None,
        }
    }

    /// The network goes on. The test prints its line.
    #[track_caller]
    pub fn passed(self) {
        let page = fs::read_to_string(root().join("docs/runbook.md")).unwrap();
        for command in &self.typed {
            assert!(
                page.contains(command),
                "`{command}` is not in docs/runbook.md"
            );
        }
        let line = json!({
            "drill": self.event,
            "played": true,
            "lost": self.lost,
            "seconds": self.since.elapsed().as_secs(),
            "typed": self.typed,
            "shortened": self.shortened,
        });
        println!("{line}");
    }
}
