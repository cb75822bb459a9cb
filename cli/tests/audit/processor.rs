//! An auditor's old processor.

use super::harness::{logged, printed};
use std::process::Command;

#[test]
fn a_processor_without_avx2_is_named_with_the_remedy() {
    let mut old = Command::new("qemu-x86_64");
    old.args(["-cpu", "Westmere", env!("CARGO_BIN_EXE_zk0"), "--version"]);
    let Ok(output) = old.output() else {
        zk0_testkit::skipped::skipped(
            "there is no qemu-x86_64; scripts/setup.sh guest installs it",
        );
        return;
    };
    let reported = logged(&output);
    match cfg!(target_feature = "avx2") {
        true => {
            assert_eq!(output.status.code(), Some(4), "{reported}");
            assert!(reported.contains("-C target-cpu=x86-64"), "{reported}");
            assert_eq!(reported.lines().count(), 1, "{reported}");
        }
        false => assert!(printed(&output).starts_with("zk0 "), "{reported}"),
    }
}
