//! What commands print. The standard library's macros panic when the disk is full, or the reader, such as `head`, has left. These do not.
//! [`finish`] reports lost output, unless the reader has left.

use anyhow::{bail, Result};
use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write};
use std::sync::OnceLock;

/// The first error of standard output.
static LOST: OnceLock<io::Error> = OnceLock::new();

/// Writes to standard output.
pub fn show(text: Arguments<'_>) {
    keep(anstream::stdout().write_fmt(text));
}

/// Writes to standard error. Failures go unreported.
pub fn tell(text: Arguments<'_>) {
    let _ = anstream::stderr().write_fmt(text);
}

/// Ends the output of a command.
///
/// # Errors
/// Output of [`show`] is not written.
pub fn finish() -> Result<()> {
    keep(io::stdout().flush());
    match LOST.get() {
        Some(error) => bail!("writing to standard output: {error}"),
        None => Ok(()),
    }
}

fn keep(written: io::Result<()>) {
    match written {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            let _ = LOST.set(error);
        }
        _ => {}
    }
}

macro_rules! say_text {
    ($($arg:tt)*) => {
        $crate::output::show(format_args!($($arg)*))
    };
}

macro_rules! say_line {
    () => {
        $crate::output::show(format_args!("\n"))
    };
    ($($arg:tt)*) => {
        $crate::output::show(format_args!("{}\n", format_args!($($arg)*)))
    };
}

macro_rules! tell_line {
    ($($arg:tt)*) => {
        $crate::output::tell(format_args!("{}\n", format_args!($($arg)*)))
    };
}

pub(crate) use say_line as println;
pub(crate) use say_text as print;
pub(crate) use tell_line as eprintln;
