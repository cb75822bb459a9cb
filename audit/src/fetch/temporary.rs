//! Temporary folders, removed even when Ctrl-C or SIGTERM ends the process. A mirror may leave gigabytes unnoticed.
//!
//! An audit cannot stop anywhere, and would report vanishing files as missing from the log. So the process becomes another program: that
//! ends all audit threads at once, and removes the folders.

use std::future::pending;
use std::io;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{self, Command};
use std::sync::mpsc::{channel, Sender};
use std::sync::{Mutex, MutexGuard, Once, PoisonError};
use std::thread;
use tempfile::TempDir;
use tokio::runtime::Builder;
use tokio::signal::unix::{signal, SignalKind};

/// This process's temporary folders, some perhaps gone.
static FOLDERS: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// A temporary folder, removed on drop and when the process is told to end.
pub struct Temporary(TempDir);

impl Temporary {
    /// Makes a folder. From the first call on, the two signals first remove the folders.
    ///
    /// # Errors
    /// The folder cannot be made.
    pub fn make() -> io::Result<Self> {
        static LISTENING: Once = Once::new();
        LISTENING.call_once(listen);
        // What ends the process waits until the list has the new folder.
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

/// Starts a thread that waits for the signals. If that fails, they end the process as before.
fn listen() {
    let (sender, listening) = channel();
    let started = thread::Builder::new().spawn(move || wait(sender));
    if started.is_ok() {
        // The thread has sent this, or given up.
        let _ = listening.recv();
    }
}

/// Waits for one of the signals, and ends the process. Sends on `listening` at its start.
fn wait(listening: Sender<()>) {
    let Ok(runtime) = Builder::new_current_thread().enable_io().build() else {
        return;
    };
    let told = async {
        let told =
            [SignalKind::interrupt(), SignalKind::terminate()].map(|kind| (kind, signal(kind)));
        let _ = listening.send(());
        let [interrupt, terminate] = told.map(|(kind, signal)| async move {
            match signal {
                Ok(mut signal) => drop(signal.recv().await),
                // This signal ends the process as before.
                Err(_) => pending().await,
            }
            kind
        });
        tokio::select! {
            kind = interrupt => kind,
            kind = terminate => kind,
        }
    };
    end(runtime.block_on(told).as_raw_value());
}

/// Removes the folders, and ends the process by this signal. For systemd that is no failure, and a shell script ends, too.
fn end(signal: i32) -> ! {
    let folders = folders();
    // A container's first process does not end by its own signal. A shell has this exit code for it.
    let code = 128 + signal;
    let script = format!(
        "trap '' INT TERM; rm -rf -- \"$@\"; trap - INT TERM; kill -{signal} $$; exit {code}"
    );
    let error = Command::new("/bin/sh")
        .args(["-c", &script, "zk0"])
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
