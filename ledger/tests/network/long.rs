//! A ledger of any length, written directly to its database: whole rounds of eight nodes, with the checkpoints that a log needs and one
//! at the end of each round.

use super::*;
use rocksdb::{Options, WriteBatch, DB};
use std::path::Path;
use tlog_tiles::tlog::stored_hash_index;
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::WeightsDigest;
use zk0_protocol::tlog::tree::Frontier;
use zk0_protocol::{Body, Checkpoint, Entry, Genesis, Signed, State};

pub const NODES: u8 = 8;

/// How many entries one round has: opened, committed, commitments closed, randomness drawn, accepted and closed.
pub const ROUND: u64 = 4 + 2 * NODES as u64;

pub struct Long {
    db: DB,
    dir: std::path::PathBuf,
    pub state: State,
    tree: Frontier,
    batch: WriteBatch,
    /// The updates made so far. The next update is made from this number and the seed.
    updates: u64,
    seed: u8,
    time_ms: u64,
}

impl Long {
    /// Founds a ledger in `dir` with eight nodes and their datasets; what its nodes train differs with `seed`.
    pub fn found(dir: &Path, seed: u8) -> Self {
        Self::found_as(dir, genesis(), seed)
    }

    pub fn found_as(dir: &Path, genesis: Genesis, seed: u8) -> Self {
        std::fs::create_dir_all(dir).unwrap();
        let mut options = Options::default();
        options.create_if_missing(true);
        let founding = entry(T0, Body::Genesis(genesis));
        let mut long = Self {
            db: DB::open(&options, dir.join("log")).unwrap(),
            dir: dir.into(),
            state: State::found(&founding).unwrap(),
            tree: Frontier::default(),
            batch: WriteBatch::default(),
            updates: 0,
            seed,
            time_ms: T0,
        };
        long.write(&founding);
        for node in 0..NODES {
            long.append(enrolled(node));
            long.append(registered(&long.state.network().clone(), node));
        }
        long.publish();
        long
    }

    /// Appends one more round.
    pub fn round(&mut self) {
        // Nothing of a round can be disputed two rounds later, so the state stays small.
        self.time_ms += 10 * SUBMIT_WINDOW;
        let opened = opened(&self.state, self.time_ms);
        self.append(Body::RoundOpened(opened));
        for node in 0..NODES {
            let update = self.update();
            self.append(committed(&self.state, node, update));
        }
        self.append(Body::CommitmentsClosed(commitments_closed(&self.state)));
        self.checkpoint();
        self.append(Body::RandomnessDrawn(drawn(&self.state)));
        for node in 0..NODES {
            self.append(accepted(&self.state, node));
        }
        let global = self.update();
        self.append(Body::RoundClosed(closed(&self.state, global)));
        self.publish();
    }

    /// Appends a round in which somebody else signs the first commitment, and returns the index of that entry. Nothing can follow
    /// it.
    pub fn forge_round(&mut self) -> u64 {
        let time_ms = self.state.time_ms();
        self.append(Body::RoundOpened(opened(&self.state, time_ms)));
        let forged = commitment(&self.state, 0, weights(1));
        let index = self.size();
        let signed = Signed::new(forged, &key(1));
        self.write(&entry(time_ms, Body::UpdateCommitted(signed)));
        self.publish();
        index
    }

    pub fn rounds(&mut self, rounds: u64) {
        (0..rounds).for_each(|_| self.round());
    }

    pub fn size(&self) -> u64 {
        self.tree.size()
    }

    fn update(&mut self) -> WeightsDigest {
        self.updates += 1;
        let number = self.updates.to_le_bytes();
        let part = |tag| tagged_sha256(tag, &[&[self.seed], &number]);
        WeightsDigest {
            blob: part("blob"),
            quantised: part("quantised"),
        }
    }

    fn append(&mut self, body: Body) {
        let entry = entry(self.time_ms, body);
        self.write(&entry);
        self.state
            .apply(&self.tree.root().unwrap(), &entry)
            .unwrap();
    }

    fn write(&mut self, entry: &Entry) {
        let (index, bytes) = (self.tree.size(), entry.encode().unwrap());
        let hashes = self.tree.push(&bytes).unwrap();
        self.batch.put(db_key(b'e', index), bytes);
        for (position, hash) in (stored_hash_index(0, index)..).zip(hashes) {
            self.batch.put(db_key(b'h', position), hash.0);
        }
    }

    fn checkpoint(&mut self) -> Vec<u8> {
        let (size, root) = (self.tree.size(), self.tree.root().unwrap());
        let text = Checkpoint { size, root }
            .sign(self.state.genesis().origin(), &log_key())
            .unwrap();
        self.batch.put(db_key(b'c', size), &text);
        text
    }

    fn publish(&mut self) {
        let text = self.checkpoint();
        self.db.write(std::mem::take(&mut self.batch)).unwrap();
        std::fs::write(self.dir.join("checkpoint"), text).unwrap();
    }
}

/// A database key.
pub fn db_key(kind: u8, number: u64) -> [u8; 9] {
    let mut key = [kind; 9];
    key[1..].copy_from_slice(&number.to_be_bytes());
    key
}
