//! The child process turns a byte stream into raw planes. It uses no files or connections, and logs only damage.

use std::io::{ErrorKind, Read, Write};
use std::os::fd::AsFd;
use std::process::{Child, ChildStderr, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use rustix::event::{poll, PollFd, PollFlags, Timespec};
use rustix::io::{ioctl_fionbio, Errno};
use rustix::pipe::fcntl_setpipe_size;
use rustix::process::{prlimit, Pid, Resource, Rlimit};

/// Time for a picture and all that is decoded before it.
const PATIENCE: Duration = Duration::from_secs(60);
/// FFmpeg's own address space; Debian's takes 400 MB.
const PROGRAM_BYTES: u64 = 1 << 30;
/// Pictures in memory: 17 references, some on their way, and tables for each.
const PICTURES: u64 = 64;
/// Its memory limit, whatever size pictures claim.
const MOST_BYTES: u64 = 8 << 30;
/// Bytes of its log in errors.
const LOG_BYTES: usize = 400;
const PIPE_BYTES: usize = 1 << 20;

const MISSING: &str = "needs FFmpeg, which is not installed; install it: sudo apt install ffmpeg";

pub(super) struct Process {
    child: Child,
    /// `None` at the stream's end.
    stdin: Option<ChildStdin>,
    stdout: ChildStdout,
    stderr: ChildStderr,
    /// Input not taken yet, from `taken` on.
    waiting: Vec<u8>,
    taken: usize,
    picture_bytes: usize,
    patience: Duration,
}

impl Process {
    /// Starts FFmpeg on a byte stream (`h264` or `hevc`) with `picture_bytes` per picture.
    pub fn start(demuxer: &str, picture_bytes: usize) -> Result<Self, String> {
        let every_picture = every_picture()?;
        let mut command = Command::new("ffmpeg");
        command
            .args("-hide_banner -nostdin -loglevel error -xerror".split(' '))
            .args("-threads 1 -err_detect crccheck+explode".split(' '))
            .args(["-f", demuxer, "-i", "pipe:0", "-map", "0:v:0"])
            .args([every_picture, "passthrough"])
            // A plus alone keeps the pictures' format.
            .args("-threads 1 -pix_fmt + -f rawvideo pipe:1".split(' '))
            // FFmpeg would log into the file that it names.
            .env_remove("FFREPORT")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let mut child = command.spawn().map_err(not_started)?;
        let pipes = (child.stdin.take(), child.stdout.take(), child.stderr.take());
        let (Some(stdin), Some(stdout), Some(stderr)) = pipes else {
            return Err("FFmpeg has no pipes".into());
        };
        let process = Self {
            child,
            stdin: Some(stdin),
            stdout,
            stderr,
            waiting: Vec::new(),
            taken: 0,
            picture_bytes,
            patience: PATIENCE,
        };
        process
            .limit()
            .map_err(|e| format!("FFmpeg cannot be limited: {e}"))?;
        Ok(process)
    }

    /// Sets limits before it reads anything.
    fn limit(&self) -> Result<(), Errno> {
        let pid = Some(Pid::from_child(&self.child));
        let pictures = PICTURES.saturating_mul(self.picture_bytes as u64);
        let memory = PROGRAM_BYTES.saturating_add(pictures).min(MOST_BYTES);
        for (resource, most) in [
            (Resource::As, memory),
            (Resource::Fsize, 0),
            (Resource::Core, 0),
        ] {
            let limit = Rlimit {
                current: Some(most),
                maximum: Some(most),
            };
            prlimit(pid, resource, limit)?;
        }
        if let Some(stdin) = &self.stdin {
            ioctl_fionbio(stdin, true)?;
        }
        ioctl_fionbio(&self.stdout, true)?;
        ioctl_fionbio(&self.stderr, true)?;
        // It decodes ahead into this pipe; a small pipe is only slower.
        let _ = fcntl_setpipe_size(&self.stdout, PIPE_BYTES);
        Ok(())
    }

    /// The next picture's planes, `None` at the end. `more` gives the stream's next bytes, `None` at its end.
    pub fn picture(
        &mut self,
        mut more: impl FnMut() -> Result<Option<Vec<u8>>, String>,
    ) -> Result<Option<Vec<u8>>, String> {
        let until = Instant::now() + self.patience;
        let mut picture = Vec::new();
        let mut part = [0; 1 << 16];
        loop {
            if self.taken == self.waiting.len() && self.stdin.is_some() {
                self.taken = 0;
                match more()? {
                    Some(bytes) => self.waiting = bytes,
                    None => {
                        self.waiting.clear();
                        self.stdin = None;
                    }
                }
            }
            self.wait(until)?;
            self.refuse_log()?;
            let missing = (self.picture_bytes - picture.len()).min(part.len());
            match self.stdout.read(&mut part[..missing]) {
                Ok(0) if picture.is_empty() => return self.end().map(|()| None),
                Ok(0) => return Err("does not decode: FFmpeg ended within a picture".into()),
                Ok(count) => picture.extend_from_slice(&part[..count]),
                Err(e) if e.kind() == ErrorKind::WouldBlock => {}
                Err(e) => return Err(format!("cannot be had from FFmpeg: {e}")),
            }
            if picture.len() == self.picture_bytes {
                // A picture's faults are logged before it comes.
                self.refuse_log()?;
                return Ok(Some(picture));
            }
            self.feed()?;
        }
    }

    fn wait(&self, until: Instant) -> Result<(), String> {
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(format!(
                "takes FFmpeg more than {} seconds; is the video damaged?",
                self.patience.as_secs()
            ));
        }
        let timeout = Timespec {
            tv_sec: left.as_secs() as i64,
            tv_nsec: left.subsec_nanos().into(),
        };
        let mut pipes = vec![
            PollFd::from_borrowed_fd(self.stdout.as_fd(), PollFlags::IN),
            PollFd::from_borrowed_fd(self.stderr.as_fd(), PollFlags::IN),
        ];
        if let Some(stdin) = &self.stdin {
            pipes.push(PollFd::from_borrowed_fd(stdin.as_fd(), PollFlags::OUT));
        }
        match poll(&mut pipes, Some(&timeout)) {
            Ok(_) | Err(Errno::INTR) => Ok(()),
            Err(e) => Err(format!("cannot be had from FFmpeg: {e}")),
        }
    }

    fn feed(&mut self) -> Result<(), String> {
        let Some(stdin) = &mut self.stdin else {
            return Ok(());
        };
        match stdin.write(&self.waiting[self.taken..]) {
            Ok(count) => self.taken += count,
            Err(e) if e.kind() == ErrorKind::WouldBlock => {}
            // It ended early; its log or status tells why.
            Err(e) if e.kind() == ErrorKind::BrokenPipe => self.stdin = None,
            Err(e) => return Err(format!("cannot be given to FFmpeg: {e}")),
        }
        Ok(())
    }

    /// Fails on any log: after many errors FFmpeg goes on with invented pictures.
    fn refuse_log(&mut self) -> Result<(), String> {
        let mut log = [0; LOG_BYTES];
        let count = match self.stderr.read(&mut log) {
            Ok(0) => return Ok(()),
            Ok(count) => count,
            Err(e) if e.kind() == ErrorKind::WouldBlock => return Ok(()),
            Err(e) => return Err(format!("cannot be had from FFmpeg: {e}")),
        };
        let log = String::from_utf8_lossy(&log[..count]);
        let line = log.lines().next().unwrap_or_default();
        // The bracketed part holds an address.
        let reported = line
            .rsplit_once("] ")
            .map_or(line, |(_, reported)| reported);
        Err(format!(
            "does not decode, as in a damaged file, or one of the next: FFmpeg states {reported:?}"
        ))
    }

    fn end(&mut self) -> Result<(), String> {
        self.stdin = None;
        let status = self.child.wait();
        self.refuse_log()?;
        match status {
            Ok(status) if status.success() => Ok(()),
            Ok(status) => Err(format!("does not decode: FFmpeg ended with {status}")),
            Err(e) => Err(format!("cannot be had from FFmpeg: {e}")),
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn not_started(e: std::io::Error) -> String {
    match e.kind() {
        ErrorKind::NotFound => MISSING.into(),
        _ => format!("needs FFmpeg, which cannot be started: {e}"),
    }
}

/// The option that outputs every picture once, whatever its time: `-fps_mode` since FFmpeg 5.1, `-vsync` before.
fn every_picture() -> Result<&'static str, String> {
    static OPTION: OnceLock<&str> = OnceLock::new();
    if let Some(option) = OPTION.get() {
        return Ok(option);
    }
    let output = Command::new("ffmpeg")
        .arg("-version")
        .env_remove("FFREPORT")
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .output()
        .map_err(not_started)?;
    let text = String::from_utf8_lossy(&output.stdout);
    Ok(OPTION.get_or_init(|| option_of(&text)))
}

fn option_of(version: &str) -> &'static str {
    let name = version.strip_prefix("ffmpeg version ").unwrap_or_default();
    let old = ["2.", "3.", "4.", "5.0"];
    if old
        .iter()
        .any(|old| name.trim_start_matches('n').starts_with(old))
    {
        "-vsync"
    } else {
        "-fps_mode"
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::video::mp4::sample::Mp4Codec;
    use crate::dataset::video::mp4::track::Mp4Track;
    use crate::dataset::video::nal;

    fn limit(process: &Process, name: &str) -> String {
        let file = format!("/proc/{}/limits", process.child.id());
        let limits = std::fs::read_to_string(file).unwrap();
        let line = limits.lines().find_map(|line| line.strip_prefix(name));
        line.unwrap().split_whitespace().next().unwrap().into()
    }

    fn address_space(process: &Process) -> String {
        limit(process, "Max address space")
    }

    #[test]
    fn the_child_has_limits_and_ends_with_its_owner() {
        let huge = Process::start("hevc", 1 << 40).unwrap();
        assert_eq!(address_space(&huge), MOST_BYTES.to_string());
        let process = Process::start("hevc", 1 << 20).unwrap();
        assert_eq!(
            address_space(&process),
            ((1 << 30) + (64 << 20)).to_string()
        );
        assert_eq!(limit(&process, "Max file size"), "0");
        assert_eq!(limit(&process, "Max core file size"), "0");
        let folder = format!("/proc/{}", process.child.id());
        drop(process);
        assert!(!std::path::Path::new(&folder).exists());
    }

    #[test]
    fn a_picture_that_does_not_come_is_given_up() {
        let mut process = Process::start("hevc", 64).unwrap();
        process.patience = Duration::from_secs(1);
        let nothing = || Ok(Some(Vec::new()));
        let error = process.picture(nothing).unwrap_err();
        assert_eq!(
            error,
            "takes FFmpeg more than 1 seconds; is the video damaged?"
        );
    }

    #[test]
    fn what_is_no_video_is_refused_in_the_words_of_ffmpeg() {
        let mut process = Process::start("hevc", 64).unwrap();
        let mut parts = vec![vec![0x5a; 1 << 16]].into_iter();
        let error = process.picture(|| Ok(parts.next())).unwrap_err();
        assert!(
            error.starts_with("does not decode, as in a damaged file"),
            "{error}"
        );
    }

    #[test]
    fn a_part_of_a_picture_is_refused() {
        let name = "../tests/fixtures/videos_other/hevc_hvc1.mp4";
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(name);
        let bytes = std::fs::read(path).unwrap();
        let track = Mp4Track::read(&mut std::io::Cursor::new(&bytes)).unwrap();
        let Mp4Codec::Hevc(config) = &track.codec else {
            panic!()
        };
        let mut samples = track.samples.iter().enumerate().map(|(at, sample)| {
            let sample = &bytes[sample.offset as usize..][..sample.size as usize];
            nal::stream(config, sample, at == 0, |unit| Ok(unit.into()))
        });
        // With a byte more per picture, the last of twelve would be incomplete.
        let mut process = Process::start("hevc", 48 * 64 * 3 / 2 + 1).unwrap();
        let end = loop {
            match process.picture(|| samples.next().transpose()) {
                Ok(Some(_)) => {}
                end => break end,
            }
        };
        let error = "does not decode: FFmpeg ended within a picture";
        assert_eq!(end, Err(error.into()));
    }

    #[test]
    fn old_releases_have_another_option() {
        for (version, option) in [
            ("ffmpeg version 4.4.2-0ubuntu0.22.04.1 Copyright", "-vsync"),
            ("ffmpeg version n4.3 Copyright", "-vsync"),
            ("ffmpeg version 5.1.9-0+deb12u1 Copyright", "-fps_mode"),
            (
                "ffmpeg version n9.0.2-17-g2a571b6068-20260930 Copyright",
                "-fps_mode",
            ),
            ("ffmpeg version N-120000-gabcdef Copyright", "-fps_mode"),
        ] {
            assert_eq!(option_of(version), option, "{version}");
        }
    }
}
