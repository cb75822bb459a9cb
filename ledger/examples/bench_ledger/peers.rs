//! The parts of a ledger by themselves. A ledger cannot be faster than they are.

use anyhow::{bail, Context, Result};
use ed25519_dalek::{Signature, SigningKey, VerifyingKey};
use rayon::prelude::*;
use rocksdb::{Options, WriteBatch, WriteOptions, DB};
use sha2::{Digest as _, Sha256};
use sp1_verifier::compressed::SP1CompressedVerifier;
use sp1_verifier::SP1Proof;
use std::path::Path;
use std::time::Instant;
use tlog_tiles::tlog::{stored_hash_count, HashReader};
use zk0_circuits::Claim;
use zk0_ledger::folder;
use zk0_ledger::store::Store;
use zk0_protocol::{Body, Entry};

/// The keys and values that one group wrote, the entries first.
pub struct Written {
    pairs: Vec<(Vec<u8>, Vec<u8>)>,
    entries: usize,
}

/// Reads what the ledger in `dir` wrote from entry `first` on, in groups of `group`.
pub fn written(dir: &Path, first: u64, group: u64) -> Result<Vec<Written>> {
    let store = Store::open_read_only(&folder::database(dir))?;
    let size = store.size()?;
    let mut groups = Vec::new();
    for start in (first..size).step_by(group as usize) {
        let end = size.min(start + group);
        let mut pairs = Vec::new();
        for index in start..end {
            let entry = store.entry(index)?.context("an entry")?;
            pairs.push((key(b'e', index), entry));
        }
        let entries = pairs.len();
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

/// The hash of an entry's leaf.
fn leaf(entry: &[u8]) -> [u8; 32] {
    let leaf = Sha256::new().chain_update([0]).chain_update(entry);
    leaf.finalize().into()
}

/// A signature that is verified again and again.
struct Sample {
    message: [u8; 400],
    signature: [u8; 64],
    public: [u8; 32],
}

impl Sample {
    fn new() -> Self {
        let key = SigningKey::from_bytes(&[5; 32]);
        let message = [3; 400];
        Self {
            message,
            signature: ed25519_dalek::Signer::sign(&key, &message).to_bytes(),
            public: key.verifying_key().to_bytes(),
        }
    }

    /// Verifies the signature this many times, on all cores.
    fn verify(&self, times: u64) -> Result<()> {
        let valid = (0..times).into_par_iter().filter(|_| {
            let key = VerifyingKey::from_bytes(&self.public);
            let signature = Signature::from_bytes(&self.signature);
            key.is_ok_and(|key| key.verify_strict(&self.message, &signature).is_ok())
        });
        anyhow::ensure!(valid.count() as u64 == times, "a signature is not valid");
        Ok(())
    }
}

/// Seconds that RocksDB takes for the same keys and values in the same synced batches, with two SHA-256 for each entry and, where
/// entries are `signed`, one ed25519 verification.
pub fn raw_writes(groups: &[Written], dir: &Path, signed: bool) -> Result<f64> {
    let sample = Sample::new();
    let mut options = Options::default();
    options.create_if_missing(true);
    let db = DB::open(&options, dir)?;
    let mut durable = WriteOptions::default();
    durable.set_sync(true);
    let started = Instant::now();
    for group in groups {
        if signed {
            sample.verify(group.entries as u64)?;
        }
        let mut node = [0; 32];
        for (_, entry) in &group.pairs[..group.entries] {
            let inner = Sha256::new().chain_update([1]).chain_update(node);
            node = inner.chain_update(leaf(entry)).finalize().into();
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
    let sample = Sample::new();
    let started = Instant::now();
    sample.verify(signatures)?;
    entries.par_iter().for_each(|entry| {
        let inner = Sha256::new()
            .chain_update([1; 65])
            .chain_update(leaf(entry));
        std::hint::black_box(inner.finalize());
    });
    Ok(started.elapsed().as_secs_f64())
}

/// Seconds that SP1's own verifier takes for `proof`, `times` over, from the bytes.
pub fn sp1_verifications(times: u32, proof: &[u8], claim: &Claim, key: &[u8]) -> Result<f64> {
    let verifier = SP1CompressedVerifier::new();
    let (claim, key) = (borsh::to_vec(claim)?, bincode::deserialize(key)?);
    let started = Instant::now();
    for _ in 0..times {
        let SP1Proof::Compressed(proof) = bincode::deserialize(proof)? else {
            bail!("no compressed proof");
        };
        verifier.verify_compressed_with_public_values(&proof, &claim, &key)?;
    }
    Ok(started.elapsed().as_secs_f64())
}
