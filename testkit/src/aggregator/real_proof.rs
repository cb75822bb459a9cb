//! A proof in the committed ledger.

use std::fs;
use std::path::Path;
use zk0_audit::verified_entries::verified_entries;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::program::Program;

/// The committed ledger.
pub const REAL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/fixtures/ledger");

/// [`REAL`]'s program, of this release, and its first accepted proof.
pub fn real_proof() -> (Program, Vec<u8>) {
    let (entries, _) = verified_entries(Path::new(REAL)).unwrap();
    let Body::Genesis(genesis) = &entries[0].body else {
        panic!("no genesis");
    };
    let mut accepted = entries.iter().filter_map(|entry| match &entry.body {
        Body::ContributionAccepted(submission) => Some(submission.statement.proof),
        _ => None,
    });
    let path = format!("{REAL}/blobs/sha256/{}", accepted.next().unwrap());
    (Program::founding(&genesis.program), fs::read(path).unwrap())
}
