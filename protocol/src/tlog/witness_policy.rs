//! Witness policies (C2SP tlog-policy): a reader's logs and witnesses, and the quorum of cosignatures that a checkpoint needs.
//!
//! ```text
//! witness A a.example+6c1bbd5e+BO… https://a.example/witness
//! witness B b.example+0f2e7a91+BM… https://b.example/witness
//! witness C c.example+93d0c1b7+BD… https://c.example/witness
//! group two-of-three 2 A B C
//! quorum two-of-three
//! ```
//!
//! A policy belongs to a reader, not to the log, so an auditor may be stricter than the aggregator.

use crate::quote::short;
use crate::tlog::checkpoint::{Checkpoint, CheckpointError, LogSignature, Parsed};
use crate::tlog::verifier_key::{KeyError, Role, VerifierKey};
use signed_note::{Verifier, VerifierList};
use std::collections::BTreeMap;
use std::fmt;

/// Longest policy that is read, in bytes.
pub const MAX_POLICY_BYTES: usize = 64 * 1024;

/// Most logs, most witnesses, and most groups.
const MAX_OF_A_KIND: usize = 64;

/// Logs, witnesses and a quorum.
#[derive(Clone, Debug)]
pub struct WitnessPolicy {
    logs: Vec<VerifierKey>,
    witnesses: Vec<PolicyWitness>,
    quorum: Quorum,
    text: String,
}

/// A policy's witness.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PolicyWitness {
    /// Its name within the policy.
    pub name: String,
    /// The key that verifies its cosignatures.
    pub key: VerifierKey,
    /// Its address for checkpoints (the submission prefix of C2SP tlog-witness), if given.
    pub url: Option<String>,
}

/// A checkpoint that a policy accepts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Witnessed {
    /// The checkpoint.
    pub checkpoint: Checkpoint,
    /// The key that signed it: the log's founding one, or one that the operator gave the log.
    pub key: [u8; 32],
    /// The entry that gave the log this key; 0 for the founding key.
    pub since: u64,
    /// The policy's witnesses that cosigned it, by name, with the time in POSIX seconds.
    pub cosigners: Vec<(String, u64)>,
}

#[derive(Clone, Debug)]
enum Quorum {
    None,
    Witness(usize),
    Group {
        threshold: usize,
        members: Vec<Quorum>,
    },
}

/// Why a text is not a policy.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WitnessPolicyError {
    /// The policy is too large.
    #[error("the policy is too large: it has {0}")]
    TooLarge(String),
    /// A line has no known form.
    #[error("policy, line {line}: '{text}' has none of the forms `log VKEY [URL]`, `witness NAME VKEY [URL]`, `group NAME all|any|K NAME…` and `quorum NAME`")]
    Line { line: usize, text: String },
    /// A key is not a verifier key.
    #[error("policy, line {line}: {error}")]
    Key { line: usize, error: KeyError },
    /// A name or a key is not allowed here.
    #[error("policy, line {line}: {why}")]
    Name { line: usize, why: String },
    /// The quorum lines are not exactly one.
    #[error("the policy has {0} quorum lines. It needs exactly one, which names the required cosignatures (`quorum none` requires none)")]
    Quorums(usize),
}

impl WitnessPolicy {
    /// The policy that requires no cosignatures.
    pub fn none() -> Self {
        Self {
            logs: Vec::new(),
            witnesses: Vec::new(),
            quorum: Quorum::None,
            text: "quorum none\n".into(),
        }
    }

    /// Reads a policy.
    pub fn parse(text: &str) -> Result<Self, WitnessPolicyError> {
        if text.len() > MAX_POLICY_BYTES {
            return Err(WitnessPolicyError::TooLarge(format!(
                "{} bytes, at most {MAX_POLICY_BYTES} are read",
                text.len()
            )));
        }
        let mut reader = PolicyParser::default();
        for (number, line) in text.lines().enumerate() {
            reader.line(number + 1, line)?;
        }
        match reader.quorums.pop() {
            Some(quorum) if reader.quorums.is_empty() => Ok(Self {
                logs: reader.logs,
                witnesses: reader.witnesses,
                quorum,
                text: text.into(),
            }),
            last => Err(WitnessPolicyError::Quorums(
                reader.quorums.len() + usize::from(last.is_some()),
            )),
        }
    }

    /// Whether the policy requires any cosignature.
    pub fn wants_witnesses(&self) -> bool {
        !matches!(self.quorum, Quorum::None)
    }

    /// The witnesses, in the order of [`WitnessPolicy::met_by`].
    pub fn witnesses(&self) -> &[PolicyWitness] {
        &self.witnesses
    }

    /// The key of the log with this origin, if named.
    pub fn log(&self, origin: &str) -> Option<&VerifierKey> {
        self.logs.iter().find(|key| key.name() == origin)
    }

    /// The logs that it names.
    pub fn logs(&self) -> &[VerifierKey] {
        &self.logs
    }

    /// Its text.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The policy for one log, for others to verify its checkpoints. `comment` becomes the first line.
    pub fn for_log(&self, log: &VerifierKey, comment: &str) -> String {
        let others = self
            .text
            .lines()
            .filter(|line| line.split_whitespace().next() != Some("log"));
        let mut text = format!("# {comment}\nlog {log}\n");
        for line in others {
            text.push_str(line);
            text.push('\n');
        }
        text
    }

    /// Whether these cosignatures, one flag for each witness, meet the quorum.
    pub fn met_by(&self, cosigned: &[bool]) -> bool {
        met(&self.quorum, cosigned)
    }

    /// Opens a checkpoint that the log signed and a quorum cosigned. `log` is the log's founding key. Signatures of unknown keys are ignored.
    /// An invalid signature of a known key makes the checkpoint invalid.
    pub fn open(&self, text: &[u8], log: &VerifierKey) -> Result<Witnessed, CheckpointError> {
        let parsed = Parsed::read(text)?;
        let LogSignature {
            key: signer, since, ..
        } = parsed.signed_by(log)?;
        let boxed = |key: &VerifierKey| Box::new(key.clone()) as Box<dyn Verifier>;
        let witnesses = self.witnesses.iter().map(|witness| boxed(&witness.key));
        let keys = VerifierList::new(std::iter::once(boxed(&signer)).chain(witnesses).collect());
        let (signatures, _) = parsed
            .note
            .verify(&keys)
            .map_err(|error| CheckpointError::Signature(error.to_string()))?;
        let time = |witness: &PolicyWitness| {
            let of = |signature: &&signed_note::Signature| {
                signature.name() == witness.key.name() && signature.id() == witness.key.id()
            };
            let bytes = signatures.iter().find(of)?.signature().first_chunk::<8>()?;
            Some(u64::from_be_bytes(*bytes))
        };
        let times: Vec<Option<u64>> = self.witnesses.iter().map(time).collect();
        let cosigned: Vec<bool> = times.iter().map(Option::is_some).collect();
        let cosigners: Vec<(String, u64)> = self
            .witnesses
            .iter()
            .zip(times)
            .filter_map(|(witness, time)| Some((witness.name.clone(), time?)))
            .collect();
        if self.met_by(&cosigned) {
            Ok(Witnessed {
                checkpoint: parsed.checkpoint,
                key: *signer.public(),
                since,
                cosigners,
            })
        } else {
            Err(CheckpointError::NoQuorum {
                size: parsed.checkpoint.size,
                found: if cosigners.is_empty() {
                    "no witness of the policy".into()
                } else {
                    let names: Vec<_> = cosigners.into_iter().map(|(name, _)| name).collect();
                    names.join(", ")
                },
                wanted: self.to_string(),
            })
        }
    }
}

impl fmt::Display for WitnessPolicy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&describe(&self.quorum, &self.witnesses))
    }
}

fn met(quorum: &Quorum, cosigned: &[bool]) -> bool {
    match quorum {
        Quorum::None => true,
        Quorum::Witness(at) => cosigned.get(*at).copied().unwrap_or(false),
        Quorum::Group { threshold, members } => {
            let count = members.iter().filter(|member| met(member, cosigned));
            count.count() >= *threshold
        }
    }
}

fn describe(quorum: &Quorum, witnesses: &[PolicyWitness]) -> String {
    match quorum {
        Quorum::None => "nobody".into(),
        Quorum::Witness(at) => witnesses[*at].name.clone(),
        Quorum::Group { threshold, members } => {
            let members: Vec<_> = members
                .iter()
                .map(|member| describe(member, witnesses))
                .collect();
            format!("{threshold} of ({})", members.join(", "))
        }
    }
}

#[derive(Default)]
struct PolicyParser {
    logs: Vec<VerifierKey>,
    witnesses: Vec<PolicyWitness>,
    named: BTreeMap<String, Named>,
    quorums: Vec<Quorum>,
}

struct Named {
    quorum: Quorum,
    /// Whether a group has it.
    taken: bool,
}

impl PolicyParser {
    fn line(&mut self, line: usize, text: &str) -> Result<(), WitnessPolicyError> {
        let controls = |c: char| c.is_control() && c != '\t';
        let words: Vec<&str> = text
            .split([' ', '\t'])
            .filter(|word| !word.is_empty())
            .collect();
        if words.first().is_none_or(|word| word.starts_with('#')) {
            return Ok(());
        }
        let key = |role, text: &str| {
            VerifierKey::of_role(role, text)
                .map_err(|error| WitnessPolicyError::Key { line, error })
        };
        match words.as_slice() {
            _ if text.contains(controls) => Err(unknown(line, text)),
            ["log", vkey] | ["log", vkey, _] => self.log(line, key(Role::Log, vkey)?),
            ["witness", name, vkey, url @ ..] if url.len() < 2 => {
                let url = url.first().map(|url| (*url).to_owned());
                self.witness(line, name, key(Role::Witness, vkey)?, url)
            }
            ["group", name, threshold, members @ ..] => {
                self.group(line, name, threshold, members, text)
            }
            ["quorum", "none"] => {
                self.quorums.push(Quorum::None);
                Ok(())
            }
            ["quorum", name] => {
                let found = self.named.get(*name).ok_or_else(|| undefined(line, name))?;
                self.quorums.push(found.quorum.clone());
                Ok(())
            }
            _ => Err(unknown(line, text)),
        }
    }

    fn log(&mut self, line: usize, key: VerifierKey) -> Result<(), WitnessPolicyError> {
        if self.logs.iter().any(|log| log.public() == key.public()) {
            return Err(twice(line, key.name()));
        }
        room("logs", self.logs.len())?;
        self.logs.push(key);
        Ok(())
    }

    fn witness(
        &mut self,
        line: usize,
        name: &str,
        key: VerifierKey,
        url: Option<String>,
    ) -> Result<(), WitnessPolicyError> {
        // With two names, one operator would count twice.
        if self
            .witnesses
            .iter()
            .any(|witness| witness.key.public() == key.public())
        {
            return Err(twice(line, key.name()));
        }
        room("witnesses", self.witnesses.len())?;
        self.define(line, name, Quorum::Witness(self.witnesses.len()))?;
        self.witnesses.push(PolicyWitness {
            name: name.into(),
            key,
            url,
        });
        Ok(())
    }

    fn group(
        &mut self,
        line: usize,
        name: &str,
        threshold: &str,
        names: &[&str],
        text: &str,
    ) -> Result<(), WitnessPolicyError> {
        let mut members = Vec::new();
        for member in names {
            let named = self
                .named
                .get_mut(*member)
                .ok_or_else(|| undefined(line, member))?;
            if std::mem::replace(&mut named.taken, true) {
                return Err(WitnessPolicyError::Name {
                    line,
                    why: format!("'{}' is already a member of a group", short(member)),
                });
            }
            members.push(named.quorum.clone());
        }
        let threshold = match threshold {
            "all" => members.len(),
            "any" => 1,
            k => k.parse().map_err(|_| unknown(line, text))?,
        };
        if !(1..=members.len()).contains(&threshold) {
            return Err(WitnessPolicyError::Name {
                line,
                why: format!(
                    "group '{}' requires {threshold} of its {} members",
                    short(name),
                    members.len()
                ),
            });
        }
        room(
            "groups",
            self.named.len().saturating_sub(self.witnesses.len()),
        )?;
        self.define(line, name, Quorum::Group { threshold, members })
    }

    fn define(
        &mut self,
        line: usize,
        name: &str,
        quorum: Quorum,
    ) -> Result<(), WitnessPolicyError> {
        let new = Named {
            quorum,
            taken: false,
        };
        if name != "none" && self.named.insert(name.into(), new).is_none() {
            Ok(())
        } else {
            Err(WitnessPolicyError::Name {
                line,
                why: format!("the name '{}' is already taken", short(name)),
            })
        }
    }
}

fn room(what: &str, count: usize) -> Result<(), WitnessPolicyError> {
    if count < MAX_OF_A_KIND {
        Ok(())
    } else {
        Err(WitnessPolicyError::TooLarge(format!(
            "more than {MAX_OF_A_KIND} {what}"
        )))
    }
}

fn unknown(line: usize, text: &str) -> WitnessPolicyError {
    WitnessPolicyError::Line {
        line,
        text: short(text),
    }
}

fn undefined(line: usize, name: &str) -> WitnessPolicyError {
    WitnessPolicyError::Name {
        line,
        why: format!("no line before it defines '{}'", short(name)),
    }
}

fn twice(line: usize, name: &str) -> WitnessPolicyError {
    WitnessPolicyError::Name {
        line,
        why: format!("the policy has the key of '{}' already", short(name)),
    }
}
