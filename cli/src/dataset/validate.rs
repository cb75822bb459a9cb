//! `zk0 dataset validate`: lists all faults of recordings.

use super::RecordingName;
use crate::output::{print, println};
use anyhow::Result;
use zk0_lerobot::dataset::{CopiedEpisodes, Dataset};
use zk0_node::progress::Progress;
use zk0_protocol::counted::counted;

/// Checks each recording, and whether they share episodes. Returns `false` if any has a fault, such as copies of its own episodes. Copies
/// of another recording's are only named.
pub fn run(recordings: &[RecordingName]) -> Result<bool> {
    let mut sound = true;
    let mut opened = Vec::new();
    for recording in recordings {
        let (report, dataset) = check(recording);
        print!("{}", report.text(recording));
        sound &= report.faults.is_empty();
        opened.extend(dataset);
    }
    for copied in CopiedEpisodes::among(&opened) {
        if !copied.within_one {
            println!("copies   {copied}");
        }
    }
    Ok(sound)
}

#[derive(Default)]
struct ValidationReport {
    size: Option<String>,
    /// Repaired while reading, because only one repair is right.
    repairs: Vec<String>,
    faults: Vec<String>,
}

fn check(recording: &RecordingName) -> (ValidationReport, Option<Dataset>) {
    let mut report = ValidationReport::default();
    let opened = recording
        .locate()
        .and_then(|folder| Ok(Dataset::open(folder)?));
    let dataset = match opened {
        Ok(dataset) => dataset,
        Err(error) => {
            report.faults.push(format!("{error:#}"));
            return (report, None);
        }
    };
    report.size = Some(format!(
        "{}, {}, {}",
        counted(dataset.episodes().len() as u64, "episode", "episodes"),
        counted(dataset.len() as u64, "frame", "frames"),
        counted(
            (dataset.len() * dataset.cameras().len()) as u64,
            "picture",
            "pictures"
        )
    ));
    report.repairs = dataset.repairs().iter().map(ToString::to_string).collect();
    let mut progress: Option<Progress> = None;
    let faults = dataset.picture_faults(|done, of| {
        progress
            .get_or_insert_with(|| Progress::start("decoding", of as u64))
            .reached(done as u64);
    });
    let left_out = dataset.left_out().iter().map(ToString::to_string);
    let statistics = match dataset.statistics_faults() {
        Ok(faults) => faults.iter().map(ToString::to_string).collect(),
        Err(error) => vec![error.to_string()],
    };
    let copied = CopiedEpisodes::among([&dataset]).into_iter();
    let undecoded = faults.into_iter().map(|fault| match fault.more_episodes {
        0 => fault.error.to_string(),
        more => format!("{} ({more} more episodes have the same fault)", fault.error),
    });
    let copied = copied.map(|copied| copied.to_string());
    report.faults = left_out
        .chain(copied)
        .chain(statistics)
        .chain(undecoded)
        .collect();
    (report, Some(dataset))
}

impl ValidationReport {
    fn text(&self, recording: &RecordingName) -> String {
        let verdict = if self.faults.is_empty() {
            "ok"
        } else {
            "FAULTY"
        };
        let mut text = format!("{verdict:<8} {recording}");
        if let Some(size) = &self.size {
            text.push_str(&format!(": {size}"));
        }
        text.push('\n');
        for (label, lines) in [("repaired", &self.repairs), ("fault", &self.faults)] {
            for line in lines {
                text.push_str(&format!("  {label:<8} {line}\n"));
            }
        }
        text
    }
}
