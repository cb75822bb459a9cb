//! An audit's report, for machines and people.

use crate::account::{Checked, NotChecked};
use crate::auditor::Auditor;
use crate::depth::Depth;
use crate::report::describe::printable;
use serde::Serialize;
use zk0_ledger::replay::{Finding, ReplayReport, Severity, Verdict};
use zk0_protocol::counted::counted;

/// The report: the replay's findings, what was checked, and what was not.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Audited {
    /// The replay's findings.
    #[serde(flatten)]
    pub report: ReplayReport,
    /// Light or full.
    pub depth: Depth,
    /// How much was checked.
    pub checked: Checked,
    /// What was not checked, by kind and reason.
    pub not_checked: Vec<NotChecked>,
}

impl Audited {
    /// The report on `auditor`'s replay.
    pub fn new(report: ReplayReport, depth: Depth, auditor: &Auditor) -> Self {
        Self {
            report,
            depth,
            checked: auditor.checked(),
            not_checked: auditor.not_checked(),
        }
    }

    /// Whether all that was checked holds. Some checks may be left out.
    pub fn holds(&self) -> bool {
        self.report.verdict != Verdict::Failed
    }
}

impl std::ops::Deref for Audited {
    type Target = ReplayReport;

    fn deref(&self) -> &ReplayReport {
        &self.report
    }
}

/// The report in words.
pub fn verdict(audited: &Audited) -> String {
    let mut text = String::new();
    let mut line = |label: &str, value: &str| text.push_str(&format!("{label:<12} {value}\n"));
    let unknown = || "unknown".to_owned();
    let report = &audited.report;
    line(
        "network",
        &printable(&report.name.clone().unwrap_or_else(unknown)),
    );
    line("id", &report.network.clone().unwrap_or_else(unknown));
    line("entries", &report.entries.to_string());
    line("checkpoints", &report.checkpoints.to_string());
    line("root", &report.root.clone().unwrap_or_else(unknown));
    line("checked", &counts(&audited.checked));
    for finding in &report.findings {
        let label = match finding.severity {
            Severity::Note => "note",
            Severity::NotChecked => "not checked",
            Severity::Fault => "FAULT",
        };
        line(label, &printable(&placed(finding)));
    }
    let (label, reports) = sentence(audited);
    line(label, reports);
    text
}

/// The faults, each with its entry. The texts may hold anything.
pub fn faults(audited: &Audited) -> Vec<String> {
    let findings = audited.report.findings.iter();
    findings
        .filter(|finding| finding.severity == Severity::Fault)
        .map(placed)
        .collect()
}

fn placed(finding: &Finding) -> String {
    match finding.index {
        Some(index) => format!("entry {index}: {}", finding.text),
        None => finding.text.clone(),
    }
}

/// The verdict in a word and a sentence.
pub fn sentence(audited: &Audited) -> (&'static str, &'static str) {
    match (audited.report.verdict, audited.depth) {
        (Verdict::Verified, _) => (
            "VERIFIED",
            "this audit checked every entry, signature, proof, update, refusal, average and result again, and all of them hold",
        ),
        (Verdict::Incomplete, Depth::Light) => (
            "INCOMPLETE",
            "light audit: weights not verified; everything that this audit checked holds",
        ),
        (Verdict::Incomplete, Depth::Full) => (
            "INCOMPLETE",
            "everything that this audit checked holds, but the lines above name what it could not check",
        ),
        (Verdict::Failed, _) => (
            "FAILED",
            "this audit found faults: do not trust this ledger",
        ),
    }
}

/// What was checked beyond the entries, in words.
pub fn counts(checked: &Checked) -> String {
    [
        counted(checked.proofs, "proof", "proofs"),
        counted(checked.updates, "update", "updates"),
        counted(checked.refusals, "refusal", "refusals"),
        counted(checked.averages, "average", "averages"),
        counted(
            checked.results,
            "evaluated result of a round",
            "evaluated results of rounds",
        ),
        counted(checked.datasets, "dataset", "datasets"),
        counted(checked.disputes, "dispute", "disputes"),
    ]
    .join(", ")
}
