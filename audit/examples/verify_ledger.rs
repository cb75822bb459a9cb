//! Verifies a ledger, proofs included: `verify_ledger FOLDER`, such as a copy of `tests/fixtures/ledger`. Ends with 1 if something is wrong.

use std::path::Path;
use std::process::ExitCode;
use zk0_audit::report::verdict::{verdict, Audited};
use zk0_audit::{Auditor, Depth};

fn main() -> ExitCode {
    let Some(folder) = std::env::args().nth(1) else {
        eprintln!("usage: verify_ledger FOLDER");
        return ExitCode::FAILURE;
    };
    // The replay checks signatures, the tree and the rules; the auditor checks proofs, refusals and averages.
    let mut auditor = Auditor::new(Depth::Full);
    let report = zk0_ledger::replay(Path::new(&folder), None, &mut auditor);
    let audited = Audited::new(report, Depth::Full, &auditor);
    print!("{}", verdict(&audited));
    if audited.holds() {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}
