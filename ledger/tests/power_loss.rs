//! The power fails, and data that was written but not synced is lost, or lost in part. The test records every write and sync of a writer
//! with strace, and puts together the disk as it may be after a failure at any of these moments. Everything that was acknowledged has
//! to be there, and the log must have signed only one history.

use crate::network::scenario::{check, child, reported, scratch as memory, strace, ENTRIES, PLAIN};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

const CALLS: &str = "?write,?writev,?pwrite64,?pwritev,?fsync,?fdatasync,?rename,?renameat,?renameat2,?openat,?open,\
                     ?creat,?truncate,?ftruncate,?unlink,?unlinkat,?rmdir,?mkdir,?mkdirat,?link,?linkat,?symlink";

/// A system call that succeeded. Paths and strings are decoded.
struct Call {
    name: String,
    /// The files that the descriptors in the arguments or the result refer to.
    descriptors: Vec<PathBuf>,
    /// The string arguments.
    strings: Vec<Vec<u8>>,
    /// The whole call as strace prints it.
    text: String,
}

/// Decodes `\x2f\x74…` to bytes.
fn unescape(text: &str) -> Vec<u8> {
    let digits: String = text.split("\\x").collect();
    hex::decode(digits).unwrap_or_else(|_| panic!("not in hexadecimal: {text}"))
}

/// Returns the texts between two characters.
fn between(text: &str, open: char, close: char) -> Vec<&str> {
    text.split(open)
        .skip(1)
        .filter_map(|part| part.split_once(close))
        .map(|(inside, _)| inside)
        .collect()
}

/// Reads what strace wrote: the calls that succeeded, in the order in which they ended.
fn calls(log: &str) -> Vec<Call> {
    let mut begun: BTreeMap<String, String> = BTreeMap::new();
    let mut calls = Vec::new();
    for line in log.lines() {
        let (thread, line) = line.split_once(' ').unwrap();
        let line = line.trim_start();
        let whole = if let Some(first) = line.strip_suffix(" <unfinished ...>") {
            begun.insert(thread.into(), first.into());
            continue;
        } else if line.starts_with("<... ") {
            let (_, rest) = line.split_once(" resumed>").unwrap();
            begun.remove(thread).unwrap() + rest
        } else {
            line.to_owned()
        };
        let Some((name, _)) = whole.split_once('(') else {
            continue;
        };
        let Some((_, result)) = whole.rsplit_once(" = ") else {
            continue;
        };
        if result.starts_with('-') || result.starts_with('?') {
            continue;
        }
        assert!(!whole.contains("\"..."), "cut off: {name}");
        let strings = whole.split('"').skip(1).step_by(2).map(unescape);
        let outside: String = whole.split('"').step_by(2).collect();
        let path = |text: &str| PathBuf::from(String::from_utf8(unescape(text)).unwrap());
        calls.push(Call {
            name: name.to_owned(),
            descriptors: between(&outside, '<', '>').into_iter().map(path).collect(),
            strings: strings.collect(),
            text: whole,
        });
    }
    calls
}

#[derive(Default)]
struct File {
    now: Vec<u8>,
    synced: Vec<u8>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Node {
    Folder,
    File(usize),
}

/// A disk: what programs see of it, and what survives a failure.
#[derive(Default)]
struct Disk {
    root: PathBuf,
    files: Vec<File>,
    names: BTreeMap<PathBuf, Node>,
    synced_names: BTreeMap<PathBuf, Node>,
}

/// What a failure leaves of the data that was not synced.
#[derive(Clone, Copy, Debug)]
enum Left {
    /// The failure leaves nothing of it.
    Nothing,
    /// The failure leaves the names of files. The files are empty, or shorter than they were.
    Names,
    /// The failure leaves the names, and the first half of what was written since.
    Half,
}

/// What a call changes with regard to failures.
enum Effect {
    Nothing,
    /// The content of a file changes.
    Content,
    /// Something becomes safe, or gets another name.
    Safety,
    /// The call prints this.
    Said(Vec<u8>),
}

impl Disk {
    fn file(&mut self, path: &Path) -> Option<&mut File> {
        match self.names.get(path) {
            Some(Node::File(id)) => Some(&mut self.files[*id]),
            _ => None,
        }
    }

    /// Takes a call into account.
    fn take(&mut self, call: &Call) -> Effect {
        let string = |at: usize| PathBuf::from(String::from_utf8_lossy(&call.strings[at]).as_ref());
        let number = |at: usize| -> usize {
            let arguments = call.text.rsplit_once(") = ").unwrap().0;
            let argument = arguments.rsplit(", ").nth(at).unwrap();
            argument.parse().unwrap_or_else(|_| panic!("{}", call.name))
        };
        match call.name.as_str() {
            "write" => {
                let written = call.text.rsplit_once(" = ").unwrap().1.parse().unwrap();
                let data = &call.strings[0][..written];
                match self.file(&call.descriptors[0].clone()) {
                    Some(file) => file.now.extend(data),
                    None => return Effect::Nothing,
                }
                Effect::Content
            }
            // This is the call with which the scenario speaks.
            "writev" => Effect::Said(call.strings.concat()),
            "pwrite64" => {
                let (at, data) = (number(0), &call.strings[0]);
                if let Some(file) = self.file(&call.descriptors[0]) {
                    let end = file.now.len().max(at + data.len());
                    file.now.resize(end, 0);
                    file.now[at..at + data.len()].copy_from_slice(data);
                }
                Effect::Content
            }
            "ftruncate" => {
                let length = number(0);
                if let Some(file) = self.file(&call.descriptors[0]) {
                    file.now.resize(length, 0);
                }
                Effect::Content
            }
            "fsync" | "fdatasync" => {
                let path = call.descriptors[0].clone();
                if let Some(file) = self.file(&path) {
                    file.synced = file.now.clone();
                } else {
                    let inside = |at: &Path| at.parent() == Some(&path);
                    self.synced_names.retain(|at, _| !inside(at));
                    let now = self.names.iter().filter(|(at, _)| inside(at));
                    self.synced_names
                        .extend(now.map(|(at, node)| (at.clone(), *node)));
                }
                Effect::Safety
            }
            "openat" | "open" => {
                let path = call.descriptors.last().unwrap().clone();
                if !path.starts_with(&self.root) || !call.text.contains("O_CREAT") {
                    assert!(!path.starts_with(&self.root) || !call.text.contains("O_TRUNC"));
                    return Effect::Nothing;
                }
                match self.file(&path) {
                    Some(file) if call.text.contains("O_TRUNC") => file.now.clear(),
                    Some(_) => {}
                    None => {
                        self.names.insert(path, Node::File(self.files.len()));
                        self.files.push(File::default());
                    }
                }
                Effect::Safety
            }
            "rename" | "renameat" | "renameat2" => {
                let node = self.names.remove(&string(0)).unwrap();
                self.names.insert(string(1), node);
                Effect::Safety
            }
            "unlink" | "unlinkat" | "rmdir" => {
                let folder = call.descriptors.first().cloned().unwrap_or_default();
                self.names.remove(&folder.join(string(0)));
                Effect::Safety
            }
            "mkdir" | "mkdirat" => {
                if string(0).starts_with(&self.root) {
                    self.names.insert(string(0), Node::Folder);
                }
                Effect::Safety
            }
            other => panic!("{other} is not understood"),
        }
    }

    /// Writes to `to` what a program finds after a failure at this moment.
    fn after_failure(&self, left: Left, to: &Path) {
        let names = match left {
            Left::Nothing => &self.synced_names,
            Left::Names | Left::Half => &self.names,
        };
        for (path, node) in names {
            let inside = path.strip_prefix(&self.root).unwrap();
            let place = to.join(inside);
            // A folder whose own name is lost loses everything in it.
            if !place.parent().unwrap().is_dir() {
                continue;
            }
            match node {
                Node::Folder => fs::create_dir(place).unwrap(),
                Node::File(id) => {
                    let File { now, synced } = &self.files[*id];
                    let half = match now.starts_with(synced) {
                        true => &now[..synced.len() + (now.len() - synced.len()) / 2],
                        false => synced,
                    };
                    let content = match left {
                        Left::Half => half,
                        Left::Nothing | Left::Names => synced,
                    };
                    fs::write(place, content).unwrap();
                }
            }
        }
    }
}

#[test]
fn after_a_power_failure_all_that_was_acknowledged_is_there() {
    power_fails_in("ledger");
}

#[test]
fn after_a_power_failure_plain_files_have_all_that_was_acknowledged() {
    power_fails_in(PLAIN);
}

/// The power fails at every moment of the scenario in the folder of this name.
fn power_fails_in(folder: &str) {
    let Some(strace) = strace() else { return };
    let scratch = memory();
    let (root, log) = (scratch.path().join("disk"), scratch.path().join("calls"));
    fs::create_dir(&root).unwrap();
    let wrapper = [
        strace.to_str().unwrap(),
        "-f",
        "--seccomp-bpf",
        "-qqq",
        "-y",
        "-xx",
        "-s",
        "9999999",
        "-o",
        log.to_str().unwrap(),
        "-e",
        &format!("trace={CALLS}"),
    ];
    // The folder above the ledger's is new, too.
    let output = child(&root.join("new").join(folder), &wrapper.map(String::from));
    let complained = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{complained}");

    let mut disk = Disk {
        root: root.clone(),
        ..Disk::default()
    };
    let mut told = Vec::new();
    let (mut failures, mut acknowledged) = (0, 0);
    for (at, call) in calls(&fs::read_to_string(&log).unwrap()).iter().enumerate() {
        let left: &[Left] = match disk.take(call) {
            Effect::Nothing => continue,
            Effect::Content => &[Left::Half],
            Effect::Safety => &[Left::Nothing, Left::Names, Left::Half],
            Effect::Said(text) => {
                told.extend(text);
                &[Left::Nothing, Left::Names, Left::Half]
            }
        };
        let reported = reported(&told);
        acknowledged = reported.receipts.len();
        if !reported.begun {
            continue;
        }
        for &left in left {
            let found = memory();
            disk.after_failure(left, found.path());
            let when = format!(
                "power fails after call {at} ({}), left: {left:?}",
                call.name
            );
            check(&found.path().join("new").join(folder), &reported, &when);
            failures += 1;
        }
    }
    assert_eq!(acknowledged, ENTRIES);
    println!("{failures} failures survived");
    assert!(failures > 300, "this tests little: {failures}");
}
