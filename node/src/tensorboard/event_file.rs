//! A file to which events are appended. A failed write is only a warning in the log: training goes on.

use crate::tensorboard::event::Event;
use crate::tensorboard::record::record;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};

/// How names of event files begin. The time follows, because TensorBoard reads them in the order of their names.
const BEGINNING: &str = "events.out.tfevents.";

/// Why there is no file.
#[derive(Debug, thiserror::Error)]
pub enum EventFileError {
    /// The folder holds the curves of another run.
    #[error("{0} holds the curves of another run: go on with that run (--resume), or choose another folder")]
    OtherRun(PathBuf),
    /// A file or its folder cannot be made.
    #[error("TensorBoard's event file cannot be written to {folder}: {error}; choose another folder, or start without event files")]
    File {
        /// The folder.
        folder: PathBuf,
        /// The system's error.
        error: io::Error,
    },
}

/// An event file of one process.
#[derive(Debug)]
pub struct EventFile {
    path: PathBuf,
    written: Mutex<WrittenFile>,
}

#[derive(Debug)]
struct WrittenFile {
    file: File,
    /// The length of all whole events.
    bytes: u64,
    /// Events lost since the last one that was written.
    lost: u64,
    /// Earlier files may hold steps that are made again.
    goes_on: bool,
}

impl EventFile {
    /// Begins a run's curves in `folder`, which is made. Files without values do not count: runs that fail before their first step leave
    /// them.
    ///
    /// # Errors
    /// The folder holds another run's curves, or cannot be written to.
    pub fn begin(folder: &Path) -> Result<Self, EventFileError> {
        let earlier = earlier(folder).map_err(failed(folder))?;
        if earlier.iter().any(|file| file.has_values) {
            Err(EventFileError::OtherRun(folder.into()))
        } else {
            Self::create(folder, &earlier).map_err(failed(folder))
        }
    }

    /// Goes on with the curves in `folder`, if any, in a further file. Readers drop later steps of earlier files ([`Event::restart`]).
    ///
    /// # Errors
    /// The folder cannot be written to.
    pub fn go_on(folder: &Path) -> Result<Self, EventFileError> {
        let earlier = earlier(folder).map_err(failed(folder))?;
        Self::create(folder, &earlier).map_err(failed(folder))
    }

    fn create(folder: &Path, earlier: &[Earlier]) -> io::Result<Self> {
        fs::create_dir_all(folder)?;
        // The clock may have been set back, or a file of this second may exist.
        let times = earlier.iter().map(|file| file.seconds.saturating_add(1));
        let seconds = times.fold(now() as u64, u64::max);
        let path = folder.join(format!("{BEGINNING}{seconds:010}.zk0"));
        let file = File::options().append(true).create_new(true).open(&path)?;
        let mut written = WrittenFile {
            file,
            bytes: 0,
            lost: 0,
            goes_on: earlier.iter().any(|file| file.has_values),
        };
        written.append(&Event::version(now()))?;
        Ok(Self {
            path,
            written: Mutex::new(written),
        })
    }

    /// Adds the values of metrics after `step` optimiser steps. A failure is logged, and later events are tried again.
    pub fn scalars(&self, step: u64, values: &[(&str, f64)]) {
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        let path = self.path.display();
        match written.scalars(step, values) {
            Ok(()) if written.lost > 0 => {
                tracing::info!(
                    "{path} is written again; it lacks {} values of steps before {step}",
                    written.lost
                );
                written.lost = 0;
            }
            Ok(()) => {}
            Err(error) => {
                if written.lost == 0 {
                    tracing::warn!(
                        "{path} cannot be written at step {step}: {error}; training goes on without it until it can be, so free some disk"
                    );
                }
                written.lost += 1;
            }
        }
    }
}

impl WrittenFile {
    fn scalars(&mut self, step: u64, values: &[(&str, f64)]) -> io::Result<()> {
        if self.goes_on {
            self.append(&Event::restart(now(), step))?;
            self.goes_on = false;
        }
        self.append(&Event::scalars(now(), step, values))
    }

    fn append(&mut self, event: &Event) -> io::Result<()> {
        let record = record(&event.bytes());
        if self.file.metadata()?.len() != self.bytes {
            // Readers would stop at a partial event.
            self.file.set_len(self.bytes)?;
        }
        self.file.write_all(&record)?;
        self.bytes += record.len() as u64;
        Ok(())
    }
}

struct Earlier {
    /// The time in its name.
    seconds: u64,
    /// Whether it holds more than its version.
    has_values: bool,
}

/// The event files in `folder`; none if it is missing.
fn earlier(folder: &Path) -> io::Result<Vec<Earlier>> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries?,
    };
    let empty = record(&Event::version(now()).bytes()).len() as u64;
    let mut files = Vec::new();
    for entry in entries {
        let entry = entry?;
        let name = entry.file_name();
        let rest = name.to_str().and_then(|name| name.strip_prefix(BEGINNING));
        let seconds = rest.and_then(|rest| rest.split('.').next()?.parse().ok());
        if let Some(seconds) = seconds {
            files.push(Earlier {
                seconds,
                has_values: entry.metadata()?.len() > empty,
            });
        }
    }
    Ok(files)
}

fn failed(folder: &Path) -> impl Fn(io::Error) -> EventFileError + '_ {
    |error| EventFileError::File {
        folder: folder.into(),
        error,
    }
}

/// Seconds since 1970.
fn now() -> f64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0.0, |since| since.as_secs_f64())
}
