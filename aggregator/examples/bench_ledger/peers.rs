//! What a ledger is made of, by itself: the least that its work can take on this machine.

use anyhow::{Context, Result};
use ed25519_dalek::{Signature, SigningKey, VerifyingKey};
use rayon::prelude::*;
use rocksdb::{Options, WriteBatch, WriteOptions, DB};
use sha2::{Digest as _, Sha256};
use std::{path::Path, time::Instant};
use tlog_tiles::tlog::{stored_hash_count, HashReader};
use zk0_ledger::{folder, store::Store, Body, Entry};

/// What one group wrote.
pub struct Written {
    /// Keys and values.
    pairs: Vec<(Vec<u8>, Vec<u8>)>,
    /// The entries among the values.
    entries: Vec<Vec<u8>>,
}

/// What the ledger in `dir` wrote from entry `first` on, in groups of `group`.
pub fn written(dir: &Path, first: u64, group: u64) -> Result<Vec<Written>> {
    let store = Store::open_read_only(&folder::database(dir))?;
    let size = store.size()?;
    let mut groups = Vec::new();
    for start in (first..size).step_by(group as usize) {
        let end = size.min(start + group);
        let mut pairs = Vec::new();
        let mut entries = Vec::new();
        for index in start..end {
            let entry = store.entry(index)?.context("an entry")?;
            pairs.push((key(b'e', index), entry.clone()));
            entries.push(entry);
        }
        let positions: Vec<u64> = (stored_hash_count(start)..stored_hash_count(end)).collect();
        let hashes = store.read_hashes(&positions)?;
        let hash = |(position, hash): (&u64, &tlog_tiles::tlog::Hash)| {
            (key(b'h', *position), hash.0.to_vec())
        };
        pairs.extend(positions.iter().zip(&hashes).map(hash));
        for size in start + 1..=end {
            if let Some(text) = store.checkpoint(size)? {
                pairs.push((key(b'c', size), text));
            }
        }
        groups.push(Written { pairs, entries });
    }
    Ok(groups)
}

fn key(kind: u8, number: u64) -> Vec<u8> {
    [&[kind][..], &number.to_be_bytes()].concat()
}

/// Seconds that RocksDB takes for the same keys and values in the same synced batches, with two SHA-256 for each entry.
pub fn raw_writes(groups: &[Written], dir: &Path) -> Result<f64> {
    let mut options = Options::default();
    options.create_if_missing(true);
    let db = DB::open(&options, dir)?;
    let mut durable = WriteOptions::default();
    durable.set_sync(true);
    let started = Instant::now();
    for group in groups {
        let mut node = [0; 32];
        for entry in &group.entries {
            let leaf = Sha256::new()
                .chain_update([0])
                .chain_update(entry)
                .finalize();
            let inner = Sha256::new().chain_update([1]).chain_update(node);
            node = inner.chain_update(leaf).finalize().into();
        }
        std::hint::black_box(node);
        let mut batch = WriteBatch::default();
        for (key, value) in &group.pairs {
            batch.put(key, value);
        }
        db.write_opt(batch, &durable)?;
    }
    Ok(started.elapsed().as_secs_f64())
}

/// Seconds that it takes, on all cores, to verify as many ed25519 signatures as the ledger in `dir` has and to hash its
/// entries, from memory.
pub fn bare_verification(dir: &Path) -> Result<f64> {
    let store = Store::open_read_only(&folder::database(dir))?;
    let (mut signatures, mut entries) = (0u64, Vec::new());
    for index in 0..store.size()? {
        let bytes = store.entry(index)?.context("an entry")?;
        signatures += match Entry::decode(&bytes)?.body {
            Body::DatasetCommitted(_)
            | Body::UpdateCommitted(_)
            | Body::ContributionAccepted(_)
            | Body::ContributionRejected { .. } => 1,
            _ => 0,
        };
        signatures += u64::from(store.checkpoint(index + 1)?.is_some());
        entries.push(bytes);
    }
    let key = SigningKey::from_bytes(&[5; 32]);
    let message = [3; 400];
    let signature = ed25519_dalek::Signer::sign(&key, &message).to_bytes();
    let public = key.verifying_key().to_bytes();
    let started = Instant::now();
    let valid = (0..signatures)
        .into_par_iter()
        .filter(|_| {
            let key = VerifyingKey::from_bytes(&public);
            let signature = Signature::from_bytes(&signature);
            key.is_ok_and(|key| key.verify_strict(&message, &signature).is_ok())
        })
        .count();
    entries.par_iter().for_each(|entry| {
        let leaf = Sha256::new()
            .chain_update([0])
            .chain_update(entry)
            .finalize();
        let inner = Sha256::new().chain_update([1; 65]).chain_update(leaf);
        std::hint::black_box(inner.finalize());
    });
    anyhow::ensure!(valid as u64 == signatures, "a signature is not valid");
    Ok(started.elapsed().as_secs_f64())
}
