//! What zk0 encodes itself.

use zk0_testkit::own_process::stderr_alone;

use super::*;

/// OpenH264 writes to stderr what it thinks of its settings, before anybody can silence it.
#[test]
fn the_encoder_says_nothing() {
    let test = "datasets::recover::encoded::the_encoder_says_nothing";
    match stderr_alone(test) {
        Some(reported) => assert_eq!(reported, ""),
        None => drop(Out::new().of(&unfinished("killed_in_batch"))),
    }
}
