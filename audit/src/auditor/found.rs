//! Findings, and what is not settled: a missing or damaged blob may be repaired, and a failing disk tells nothing about the ledger.

use crate::account::{Account, SkipReason};
use crate::checks::check::Check;
use std::collections::BTreeSet;
use std::mem::take;
use zk0_circuits::Digest;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::replay::Finding;

/// Findings, and unsettled checks.
#[derive(Default)]
pub struct Found {
    findings: Vec<Finding>,
    /// Missing or damaged blobs. Their results are not final.
    awaited: BTreeSet<Digest>,
    /// Whether the auditor can copy damaged blobs again.
    copied: bool,
    /// Damaged blobs in the auditor's copy.
    damaged: BTreeSet<Digest>,
    /// How many checks a disk prevented, and the first.
    unread: Option<(u64, Finding)>,
}

impl Found {
    /// Findings in the auditor's own copy of a ledger.
    pub fn in_copy(self) -> Self {
        Self {
            copied: true,
            ..self
        }
    }

    /// Continues an earlier audit that waited for these blobs.
    ///
    /// # Errors
    /// One of them is whole now, so its check must run again.
    pub fn go_on(self, awaited: BTreeSet<Digest>, blobs: &Blobs) -> Result<Self, String> {
        match awaited.iter().find(|blob| blobs.check(blob).is_ok()) {
            Some(blob) => Err(format!(
                "the blob {blob} was missing or damaged in an earlier audit, and is there now"
            )),
            None => Ok(Self { awaited, ..self }),
        }
    }

    /// Records the outcome of a check of entry `index`.
    pub fn enter(&mut self, account: &mut Account, index: u64, check: Check) {
        match check {
            Check::Passed(what) => account.passed(what),
            Check::LeftOut(what, why, example) => account.left_out(what, why, index, example),
            Check::NotAtHand(what, blob, example) => {
                self.awaited.insert(blob);
                account.left_out(what, SkipReason::NotAtHand, index, example);
            }
            Check::Failed(why) => self.push(Finding::fault(index, why)),
            Check::Damaged(blob, why) if self.copied => {
                self.damaged.insert(blob);
                self.unread(index, why);
            }
            Check::Lost(blob, why) | Check::Damaged(blob, why) => {
                self.awaited.insert(blob);
                self.push(Finding::fault(index, why));
            }
            Check::Unread(why) => self.unread(index, why),
        }
    }

    /// Adds a final finding.
    pub fn push(&mut self, finding: Finding) {
        self.findings.push(finding);
    }

    /// The findings since the last call.
    pub fn take(&mut self) -> Vec<Finding> {
        take(&mut self.findings)
    }

    fn unread(&mut self, index: u64, why: String) {
        let first = || (0, Finding::not_checked(index, why));
        self.unread.get_or_insert_with(first).0 += 1;
    }

    /// The blobs for a later audit to look for.
    pub fn awaited(&self) -> &BTreeSet<Digest> {
        &self.awaited
    }

    /// The damaged blobs in the auditor's copy.
    pub fn damaged(&self) -> &BTreeSet<Digest> {
        &self.damaged
    }

    /// What a disk kept from being checked, if anything.
    pub fn not_read(&self) -> Option<Finding> {
        let (count, first) = self.unread.as_ref()?;
        let text = match count {
            1 => first.text.clone(),
            count => format!(
                "{count} checks could not be done; the first: {}",
                first.text
            ),
        };
        Some(Finding {
            text,
            ..first.clone()
        })
    }
}
