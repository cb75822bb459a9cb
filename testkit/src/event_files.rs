//! A reader of event files, with its own checksum.

use prost::Message;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use zk0_node::tensorboard::event::Event;

/// CRC-32C (RFC 3720), bit by bit.
fn crc32c(bytes: &[u8]) -> u32 {
    let step = |crc: u32, _| (crc >> 1) ^ (0x82f6_3b78 & (crc & 1).wrapping_neg());
    let fed = bytes
        .iter()
        .fold(!0, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), step));
    !fed
}

fn masked(bytes: &[u8]) -> u32 {
    let crc = crc32c(bytes);
    crc.rotate_right(15).wrapping_add(0xa282_ead8)
}

fn number(bytes: &[u8]) -> u32 {
    u32::from_le_bytes(bytes.try_into().unwrap())
}

/// Data of each record.
#[track_caller]
pub fn records(mut bytes: &[u8]) -> Vec<Vec<u8>> {
    let mut records = Vec::new();
    while !bytes.is_empty() {
        let (length, rest) = bytes.split_at(8);
        let (checksum, rest) = rest.split_at(4);
        assert_eq!(number(checksum), masked(length), "checksum of a length");
        let length = u64::from_le_bytes(length.try_into().unwrap()) as usize;
        let (data, rest) = rest.split_at(length);
        let (checksum, rest) = rest.split_at(4);
        assert_eq!(number(checksum), masked(data), "checksum of an event");
        records.push(data.to_vec());
        bytes = rest;
    }
    records
}

/// A file's events.
#[track_caller]
pub fn events(path: &Path) -> Vec<Event> {
    let records = records(&fs::read(path).unwrap());
    let decoded = records.iter().map(|data| Event::decode(&data[..]));
    decoded.collect::<Result<_, _>>().unwrap()
}

/// Event files in TensorBoard's order.
pub fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
    let files = entries.filter(|entry| {
        let name = entry.file_name();
        name.to_str().unwrap().contains("tfevents")
    });
    let mut files: Vec<_> = files.map(|entry| entry.path()).collect();
    files.sort();
    files
}

/// TensorBoard's curves: each metric by steps.
#[track_caller]
pub fn curves(folder: &Path) -> BTreeMap<String, BTreeMap<i64, f32>> {
    let mut curves = BTreeMap::<String, BTreeMap<i64, f32>>::new();
    for event in files(folder).iter().flat_map(|file| events(file)) {
        if event.session_log.is_some_and(|log| log.status == 1) {
            let drop = |curve: &mut BTreeMap<i64, f32>| drop(curve.split_off(&event.step));
            curves.values_mut().for_each(drop);
        }
        for value in event.summary.into_iter().flat_map(|summary| summary.values) {
            let curve = curves.entry(value.tag).or_default();
            let before = curve.insert(event.step, value.simple_value.unwrap());
            assert_eq!(before, None, "step {} twice", event.step);
        }
    }
    curves
}
