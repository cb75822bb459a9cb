//! `zk0 dataset recover`: saves what is whole of a recording that ended too early, or whose videos do not fit.

use crate::output::print;
use anyhow::{Context, Result};
use std::path::Path;
use zk0_lerobot::dataset::{recover, Recovered};
use zk0_protocol::counted::counted;

/// Writes the new folder, and prints what was saved and lost.
pub fn run(folder: &Path, out: &Path) -> Result<()> {
    let recovered = recover(folder, out).context("nothing was saved")?;
    print!("{}", text(&recovered, out));
    Ok(())
}

fn text(recovered: &Recovered, out: &Path) -> String {
    let mut text = format!(
        "saved    {}: {}, {}\n",
        out.display(),
        counted(recovered.saved.len() as u64, "episode", "episodes"),
        counted(recovered.frames() as u64, "frame", "frames"),
    );
    for (number, saved) in recovered.saved.iter().enumerate() {
        let frames = counted(saved.frames as u64, "frame", "frames");
        text.push_str(&format!("  episode {number}: {frames}"));
        if saved.recorded_as != number as u64 {
            text.push_str(&format!(", recorded as episode {}", saved.recorded_as));
        }
        if saved.encoded_here {
            text.push_str(", its pictures encoded as H.264 by zk0");
        }
        text.push('\n');
    }
    for lost in &recovered.lost {
        text.push_str(&format!("lost     {lost}\n"));
    }
    for note in &recovered.notes {
        text.push_str(&format!("note     {note}\n"));
    }
    text.push_str(&format!(
        "next     zk0 dataset validate {} decodes every picture\n",
        out.display()
    ));
    text
}
