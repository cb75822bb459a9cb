//! Follows a network's log: `follow_log FOLDER CHECKPOINT`. FOLDER is an export, such as `tests/fixtures/export`; CHECKPOINT is the file where the
//! reader keeps the newest checkpoint. Prints the entries that are new, after it has checked that the log continues that checkpoint.

use std::error::Error;
use std::path::Path;
use std::{env, fs};
use zk0_ledger::published::reader::{first_entry, PublishedLog};
use zk0_ledger::published::source::FolderSource;
use zk0_protocol::tlog::checkpoint::Parsed;
use zk0_protocol::tlog::witness_policy::WitnessPolicy;
use zk0_protocol::{Body, Entry};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [folder, kept] = &arguments[..] else {
        return Err("usage: follow_log FOLDER CHECKPOINT".into());
    };
    let source = FolderSource::at(Path::new(folder));
    // The first entry names the log's key. A reader who knows the network's id compares `genesis.network_id()` with it.
    let Body::Genesis(genesis) = Entry::decode(&first_entry(&source)?)?.body else {
        return Err("the log's first entry is not a genesis".into());
    };
    let log = PublishedLog::open(&source, &genesis.verifier_key()?, &WitnessPolicy::none())?;
    let mut known = 0;
    if Path::new(kept).exists() {
        let checkpoint = Parsed::read(&fs::read(kept)?)?.checkpoint;
        log.continues(&checkpoint)?;
        known = checkpoint.size;
    }
    for index in known..log.checkpoint().size {
        let entry = Entry::decode(&log.entry(index)?)?;
        println!("{index}: {:?}", entry.body);
    }
    fs::write(kept, log.text())?;
    Ok(())
}
