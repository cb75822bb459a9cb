//! Temporary folders that are removed even if the process is told to end, by Ctrl-C or by SIGTERM. A mirror may have gigabytes, and a
//! folder that nobody knows of stays for good.
//!
//! An audit cannot stop at any place, and it must not see the files vanish under it: it would report them as missing from the log. So the
//! process becomes another program, which removes the folders. That ends all threads of the audit at once.

use nix::sys::signal::{SigSet, Signal};
use std::io;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{self, Command};
use std::sync::{Mutex, MutexGuard, Once, PoisonError};
use std::thread;
use tempfile::TempDir;

/// All temporary folders of this process. Some may be gone already.
static FOLDERS: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// A temporary folder. It is removed when this value is dropped, and when the process is told to end.
pub struct Temporary(TempDir);

impl Temporary {
    /// Makes a folder. The first call blocks the two signals in the thread that makes it, and in the threads that this one starts later.
    ///
    /// # Errors
    /// The folder cannot be made.
    pub fn make() -> io::Result<Self> {
        static LISTENING: Once = Once::new();
        LISTENING.call_once(listen);
        // Whoever ends the process waits until the new folder is in the list.
        let mut folders = folders();
        let made = tempfile::tempdir()?;
        folders.push(made.path().to_owned());
        Ok(Self(made))
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        self.0.path()
    }
}

fn folders() -> MutexGuard<'static, Vec<PathBuf>> {
    FOLDERS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Starts a thread that waits for the signals. If that is not possible, they end the process as before.
fn listen() {
    let mut signals = SigSet::empty();
    signals.add(Signal::SIGINT);
    signals.add(Signal::SIGTERM);
    if signals.thread_block().is_err() {
        return;
    }
    let waiting = thread::Builder::new().spawn(move || {
        if let Ok(signal) = signals.wait() {
            // This is the exit code that a shell gives for a program that the signal has ended.
            end(128 + signal as i32);
        }
    });
    if waiting.is_err() {
        let _ = signals.thread_unblock();
    }
}

/// Ends the process with this exit code, after the folders are removed.
fn end(code: i32) -> ! {
    let folders = folders();
    let error = Command::new("/bin/sh")
        .args(["-c", &format!("rm -rf -- \"$@\"; exit {code}"), "zk0"])
        .args(&*folders)
        .exec();
    let left: Vec<_> = folders
        .iter()
        .map(|path| path.display().to_string())
        .collect();
    tracing::error!(
        "remove {} by hand, because /bin/sh cannot be started: {error}",
        left.join(" and ")
    );
    process::exit(code)
}
