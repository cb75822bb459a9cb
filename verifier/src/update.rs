//! The weight check: the uploaded file holds the proven weights, and the base's where the evaluation does not read.

use crate::contribution_blobs::WeightFiles;
use crate::norm::check_norm;
use crate::weight_claims::check_weight_claims;
use zk0_circuits::model::spec::{EvalSpec, SpecError};
use zk0_circuits::model::weights::succinct_digest;
use zk0_circuits::{Claim, Digest, Mode, QuantisedWeights, WeightsDigest};
use zk0_protocol::blob::blob_digest;
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::refusal::claim_field::ClaimField;
use zk0_protocol::rules::claim_context::VerificationTerms;
use zk0_protocol::rules::network_rules::Rules;
use zk0_protocol::rules::state::State;
use zk0_protocol::{Refusal, RefusalCode};
use zk0_weights::{BuiltFile, Changed, Format, Unread, WeightFileError};

/// A network's evaluation, which determines the format of its weights.
#[derive(Clone, Debug)]
pub struct Evaluation {
    mode: Mode,
    format: Format,
}

/// An update that passed [`Evaluation::check_weights`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CheckedUpdate {
    /// The weights.
    pub weights: QuantisedWeights,
    /// The base's unread part.
    pub unread: Unread,
}

impl Evaluation {
    /// The evaluation in a network's genesis.
    pub fn of(state: &State) -> Result<Self, Refusal> {
        Self::of_genesis(state.genesis())
    }

    /// The evaluation in `genesis`.
    pub fn of_genesis(genesis: &Genesis) -> Result<Self, Refusal> {
        Self::decode(&genesis.evaluation, genesis.mode)
    }

    /// The evaluation for contributions.
    pub fn of_terms(terms: &VerificationTerms) -> Result<Self, Refusal> {
        Self::decode(&terms.evaluation, terms.mode)
    }

    fn decode(evaluation: &[u8], mode: Mode) -> Result<Self, Refusal> {
        EvalSpec::decode(evaluation)
            .and_then(|spec| Self::new(&spec, mode))
            .map_err(|error| {
                RefusalCode::MalformedUpdate.because(format_args!("no rule to read it by: {error}"))
            })
    }

    /// An evaluation proven in `mode`.
    ///
    /// # Errors
    /// The specification is not valid.
    pub fn new(spec: &EvalSpec, mode: Mode) -> Result<Self, SpecError> {
        let format = Format::new(spec)?;
        Ok(Self { mode, format })
    }

    /// The format of weight files.
    pub fn format(&self) -> &Format {
        &self.format
    }

    /// Reads the weights of a file.
    pub fn read(&self, file: &[u8]) -> Result<QuantisedWeights, Refusal> {
        self.format.read(file).map_err(malformed)
    }

    /// The digest of `weights`, whose file is `file`.
    pub fn digest(&self, file: &[u8], weights: &QuantisedWeights) -> WeightsDigest {
        WeightsDigest {
            blob: blob_digest(file),
            quantised: weights.digest(self.mode),
        }
    }

    /// The digest of a built file, its two halves computed at once.
    pub fn digest_of(&self, file: &BuiltFile) -> Result<WeightsDigest, WeightFileError> {
        let quantised = || match self.mode {
            // A copy of the numbers would take as long as the digest.
            Mode::Succinct => Ok(succinct_digest(file.numbers())),
            Mode::Direct => Ok(file.weights(self.format.spec())?.digest(self.mode)),
        };
        let (blob, quantised) = rayon::join(|| blob_digest(file.bytes()), quantised);
        quantised.map(|quantised| WeightsDigest { blob, quantised })
    }

    /// Checks `claim`'s weights: the files are the claimed ones, the update's numbers were evaluated, unread ones are the base's,
    /// what the proof leaves to check holds (`weight_check`), and the distance from the base is within `rules`.
    pub fn check_weights(
        &self,
        claim: &Claim,
        weight_check: &[u8],
        files: &WeightFiles,
        rules: &Rules,
    ) -> Result<CheckedUpdate, Refusal> {
        let WeightFiles { update, base } = files;
        let weights = self.check_update(update, &claim.terms.update)?;
        check_blob(base, &claim.terms.base.blob)?;
        let opened = self.format.open(&base[..]).map_err(malformed)?;
        let unread = Unread::of(&self.format, &opened).map_err(malformed)?;
        unread.check(&self.format, &weights).map_err(changed)?;
        self.check_what_is_left(claim, weight_check, base, update)?;
        match rules.max_update_norm_bps {
            0 => {}
            limit => check_norm(&self.format, &opened, &weights, limit)?,
        }
        Ok(CheckedUpdate { weights, unread })
    }

    /// Checks the digests of `file` and of its numbers.
    pub fn check_update(
        &self,
        file: &[u8],
        claimed: &WeightsDigest,
    ) -> Result<QuantisedWeights, Refusal> {
        check_blob(file, &claimed.blob)?;
        let weights = self.read(file)?;
        let actual = weights.digest(self.mode);
        if actual == claimed.quantised {
            Ok(weights)
        } else {
            Err(RefusalCode::OtherWeights {
                proven: claimed.quantised,
                actual,
            }
            .into())
        }
    }

    /// Checks what the proof of `claim` leaves to check in the files `base` and `update`.
    fn check_what_is_left(
        &self,
        claim: &Claim,
        weight_check: &[u8],
        base: &[u8],
        update: &[u8],
    ) -> Result<(), Refusal> {
        let format = &self.format;
        match (self.mode, claim.weight_check) {
            (Mode::Direct, None) => Ok(()),
            (Mode::Succinct, Some(claimed)) => {
                check_weight_claims(format, &claimed, weight_check, base, update)
            }
            (mode, check) => {
                let claimed = if check.is_some() { "some" } else { "none" };
                let detail = format!("it is {claimed}, but the network's mode is {mode}");
                Err(RefusalCode::Binding(ClaimField::WeightCheck).because(detail))
            }
        }
    }
}

/// Checks that a file is the claimed one.
fn check_blob(file: &[u8], expected: &Digest) -> Result<(), Refusal> {
    let actual = blob_digest(file);
    if actual == *expected {
        Ok(())
    } else {
        Err(RefusalCode::UpdateDigest {
            expected: *expected,
            actual,
        }
        .into())
    }
}

fn malformed(error: impl ToString) -> Refusal {
    RefusalCode::MalformedUpdate.because(error.to_string())
}

fn changed(changed: Changed) -> Refusal {
    let Changed {
        number,
        name,
        index,
        found,
        expected,
        bits,
    } = changed;
    let code = RefusalCode::UnreadWeights {
        tensor: number,
        index,
        found,
        expected,
        bits,
    };
    code.because(format_args!("tensor {number} is '{name}'"))
}
