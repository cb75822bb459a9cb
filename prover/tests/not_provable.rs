//! Why a claim is not proven: it does not hold, or a file fails, which states nothing about the claim.

use std::borrow::Cow;
use std::cell::Cell;
use std::io;
use std::path::Path;
use zk0_argument::claim::ClaimSource;
use zk0_circuits::claim::private_input::Header;
use zk0_circuits::{Digest, EvalSpec, Mode, PrivateInput, QuantisedWeights, Sample};
use zk0_prover::program::{synthetic, PreparedClaim};

/// A private input of which a sample cannot be read once.
struct FailsOnce {
    input: PrivateInput,
    failed: Cell<bool>,
}

impl ClaimSource for FailsOnce {
    fn header(&self) -> &Header {
        self.input.header()
    }

    fn models(&self) -> [&QuantisedWeights; 2] {
        self.input.models()
    }

    fn places(&self) -> Vec<(u64, &[Digest])> {
        self.input.places()
    }

    fn sample(&self, position: usize) -> io::Result<Cow<'_, Sample>> {
        match self.failed.replace(true) {
            false => Err(io::Error::other("the disk is broken")),
            true => self.input.sample(position),
        }
    }
}

#[test]
fn a_file_that_fails_says_nothing_about_the_claim() {
    for mode in [Mode::Direct, Mode::Succinct] {
        let spec = EvalSpec::micro();
        let source = FailsOnce {
            input: synthetic::private_input(&spec, mode, 3, 1).unwrap(),
            failed: Cell::new(false),
        };
        let blind = synthetic::blind(1);
        let prepared = |folder| PreparedClaim::of(mode, &source, &blind, folder, &mut |_| {});
        let error = prepared(None).unwrap_err();
        assert!(error.may_pass(), "{error}");
        if mode == Mode::Succinct {
            let nowhere = Path::new("/nowhere/at all");
            let error = prepared(Some(nowhere)).unwrap_err();
            assert!(error.may_pass(), "{error}");
        }
        assert!(prepared(None).is_ok());

        // The update is the base, so nothing is better.
        let mut worse = source.input.clone();
        worse.update = worse.base.clone();
        let error = PreparedClaim::of(mode, &worse, &blind, None, &mut |_| {}).unwrap_err();
        assert!(!error.may_pass(), "{error}");
    }
}
