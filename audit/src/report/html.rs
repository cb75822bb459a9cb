//! The report as one HTML file without scripts or loaded files, readable offline and on paper.
//!
//! Names, reasons and findings are untrusted. [`HtmlPage`] escapes them. If that failed, the page's security policy still forbids scripts
//! and addresses.

use crate::report::describe::time;
use crate::report::history::{History, NetworkSummary};
use crate::report::page::HtmlPage;
use crate::report::rollouts::Rollouts;
use crate::report::verdict::{counts, sentence, Audited};
use serde::Serialize;
use zk0_ledger::replay::{Finding, Severity, Verdict};
use zk0_protocol::counted::counted;

/// Most rows in a table. The data beside the page are complete.
const MOST_ROWS: usize = 500;

/// The data beside the page.
#[derive(Serialize)]
pub struct PageData<'a> {
    /// The audit.
    pub audit: &'a Audited,
    /// What happened.
    pub history: &'a History,
    /// Simulations of exported policies, which are not proven.
    pub rollouts: &'a [Rollouts],
}

const STYLE: &str = "
body { font: 15px/1.45 system-ui, sans-serif; color: #222; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; margin: 0 0 .2rem; overflow-wrap: anywhere; } h2 { font-size: 1.1rem; margin: 2rem 0 .5rem; border-bottom: 1px solid #ccc; }
h3 { font-size: 1rem; margin: 1rem 0 .2rem; }
.verdict { padding: .8rem 1rem; border-left: .5rem solid; margin: 1rem 0; }
.good { border-color: #009e73; background: #eaf6f2; } .bad { border-color: #d55e00; background: #fbefe8; }
.partial { border-color: #e69f00; background: #fdf5e5; }
.verdict b { font-size: 1.2rem; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: .2rem .6rem .2rem 0; border-bottom: 1px solid #eee; vertical-align: top; overflow-wrap: anywhere; }
th { font-weight: 600; } td:first-child { min-width: 4rem; } .n { text-align: right; overflow-wrap: normal; white-space: nowrap; }
code { font: 12px/1.4 ui-monospace, monospace; overflow-wrap: anywhere; }
.charts { display: grid; grid-template-columns: 1fr; gap: 1rem; } figure { margin: 0; break-inside: avoid; }
figcaption { font-weight: 600; } .small { color: #555; font-size: .9rem; } .fault { color: #a33f00; }
@media print { body { margin: 0; max-width: none; font-size: 11px; } h2 { break-after: avoid; } tr { break-inside: avoid; } }
";

/// The page.
pub fn page(audited: &Audited, history: &History, rollouts: &[Rollouts]) -> String {
    let mut page = HtmlPage::default();
    page.markup("<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
        <meta name=\"viewport\" content=\"width=device-width\">\
        <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'\"><title>");
    page.text(format_args!("Audit of {}", name(audited)));
    page.markup("</title><style>");
    page.markup(STYLE);
    page.markup("</style></head><body><h1>");
    page.text(name(audited));
    page.markup("</h1><div class=\"small\">network <code>");
    page.text(audited.network.as_deref().unwrap_or("unknown"));
    page.markup("</code></div>");
    page.verdict(audited, history);
    page.scope(audited);
    page.findings(&audited.findings);
    page.charts(history);
    page.rounds(history);
    page.rollouts(rollouts);
    page.nodes(history);
    page.governance(history);
    page.facts(audited, history);
    page.markup("</body></html>\n");
    page.finish()
}

fn name(audited: &Audited) -> &str {
    audited.name.as_deref().unwrap_or("an unknown network")
}

impl HtmlPage {
    fn verdict(&mut self, audited: &Audited, history: &History) {
        self.markup(match audited.verdict {
            Verdict::Verified => "<div class=\"verdict good\"><b>",
            Verdict::Incomplete => "<div class=\"verdict partial\"><b>",
            Verdict::Failed => "<div class=\"verdict bad\"><b>",
        });
        let (word, reports) = sentence(audited);
        self.text(word);
        self.markup("</b><br>");
        self.text(reports);
        self.markup(".<br>");
        self.text(format_args!(
            "The log has {}. The last one was recorded at {}.",
            counted(audited.entries, "entry", "entries"),
            time(history.last_ms)
        ));
        self.markup("</div>");
    }

    fn scope(&mut self, audited: &Audited) {
        self.heading("What was checked");
        self.markup("<p>");
        self.text(format_args!(
            "The audit checked the encoding, the signatures and the place in the log of {}, the signatures of {}, and \
             the network's rules at every entry. It also checked {}.",
            counted(audited.entries, "entry", "entries"),
            counted(audited.checkpoints, "checkpoint", "checkpoints"),
            counts(&audited.checked)
        ));
        self.markup("</p><p>");
        if audited.not_checked.is_empty() {
            self.text("The audit left nothing out.")
        } else {
            self.markup("<b>Not checked:</b></p><ul>");
            for left_out in &audited.not_checked {
                self.markup("<li>");
                self.text(left_out);
                self.markup("</li>");
            }
            self.markup("</ul><p>");
        }
        self.markup("</p>");
    }

    fn findings(&mut self, findings: &[Finding]) {
        let faults: Vec<_> = of(findings, Severity::Fault);
        let notes: Vec<_> = of(findings, Severity::Note);
        self.heading("Findings");
        if faults.is_empty() && notes.is_empty() {
            self.markup("<p>The audit found no faults, and it has no notes.</p>");
            return;
        }
        self.markup("<ul>");
        for finding in faults.iter().chain(&notes).take(MOST_ROWS) {
            match finding.severity {
                Severity::Fault => self.markup("<li class=\"fault\">"),
                Severity::Note | Severity::NotChecked => self.markup("<li>"),
            }
            if let Some(index) = finding.index {
                self.text(format_args!("entry {index}: "));
            }
            self.text(&finding.text);
            self.markup("</li>");
        }
        self.markup("</ul>");
        self.left_out(faults.len() + notes.len());
    }

    fn left_out(&mut self, count: usize) {
        if count > MOST_ROWS {
            self.markup("<p class=\"small\">");
            self.text(format_args!(
                "The JSON file that belongs to this page has {} more.",
                count - MOST_ROWS
            ));
            self.markup("</p>");
        }
    }

    fn rounds(&mut self, history: &History) {
        self.heading("Rounds");
        let columns = [
            "#round",
            "opened",
            "closed",
            "#committed",
            "#accepted",
            "#refused",
            "#unanswered",
            "#loss before",
            "#loss after",
            "#public loss, base",
            "#public loss, result",
            "result",
            "#entry",
        ];
        self.table(&columns);
        for round in history.rounds.iter().rev().take(MOST_ROWS) {
            let loss = |loss: Option<f64>| loss.map_or("–".into(), |loss| format!("{loss:.5}"));
            self.row(
                &columns,
                &[
                    &round.round,
                    &time(round.opened_ms),
                    &round.closed_ms.map_or("open".into(), time),
                    &round.committed,
                    &round.accepted,
                    &round.refused,
                    &round.unanswered,
                    &loss(round.losses.map(|losses| losses.before)),
                    &loss(round.losses.map(|losses| losses.after)),
                    &loss(round.public.as_ref().and_then(|public| public.base)),
                    &loss(round.public.as_ref().and_then(|public| public.result)),
                    &round.public.as_ref().map_or("–", |public| public.verdict()),
                    &round.opened_entry,
                ],
            );
        }
        self.end_table();
        self.left_out(history.rounds.len());
    }

    fn nodes(&mut self, history: &History) {
        self.heading("Nodes");
        let columns = [
            "name",
            "identity",
            "#samples",
            "#committed",
            "#accepted",
            "#refused",
            "#unanswered",
            "#acceptance",
            "#credits",
        ];
        self.table(&columns);
        for node in history.nodes.iter().take(MOST_ROWS) {
            let acceptance = node
                .acceptance()
                .map_or("–".into(), |share| format!("{:.0} %", share * 100.0));
            self.row(
                &columns,
                &[
                    &node.name,
                    &node.id,
                    &node.samples,
                    &node.committed,
                    &node.accepted,
                    &node.refused,
                    &node.unanswered,
                    &acceptance,
                    &node.credits,
                ],
            );
        }
        self.end_table();
        self.left_out(history.nodes.len());
    }

    fn governance(&mut self, history: &History) {
        if !history.proposals.is_empty() {
            self.heading("Proposals");
            let columns = [
                "#proposal",
                "title",
                "what it does",
                "#ballots",
                "outcome",
                "#entry",
            ];
            self.table(&columns);
            for one in history.proposals.iter().rev().take(MOST_ROWS) {
                let outcome = one.outcome.as_deref().unwrap_or("open");
                self.row(
                    &columns,
                    &[
                        &one.proposal,
                        &one.title,
                        &one.action,
                        &one.votes,
                        &outcome,
                        &one.proposed_entry,
                    ],
                );
            }
            self.end_table();
            self.left_out(history.proposals.len());
        }
        if !history.disputes.is_empty() {
            self.heading("Disputes");
            let columns = ["#contribution", "disputed by", "outcome", "#entry"];
            self.table(&columns);
            for one in history.disputes.iter().rev().take(MOST_ROWS) {
                let outcome = match one.upheld {
                    None => "open",
                    Some(true) => "upheld: the node lost the credits that it had earned for it",
                    Some(false) => "dismissed",
                };
                self.row(
                    &columns,
                    &[
                        &format!("entry {}", one.contribution),
                        &one.disputer,
                        &outcome,
                        &one.disputed_entry,
                    ],
                );
            }
            self.end_table();
            self.left_out(history.disputes.len());
        }
    }

    fn facts(&mut self, audited: &Audited, history: &History) {
        let Some(network) = &history.network else {
            return;
        };
        self.heading("The network");
        let columns = ["", ""];
        self.table(&columns);
        self.row(&columns, &[&"founded", &time(network.founded_ms)]);
        self.row(&columns, &[&"log key", &network.log_key]);
        self.row(
            &columns,
            &[
                &"root of the log",
                &audited.root.as_deref().unwrap_or("unknown"),
            ],
        );
        self.row(
            &columns,
            &[
                &"state of the network",
                &audited.state.as_deref().unwrap_or("unknown"),
            ],
        );
        self.row(&columns, &[&"mode of the proofs", &network.mode]);
        for program in &history.programs {
            self.row(&columns, &[&"guest program", &program.to_string()]);
        }
        self.row(&columns, &[&"evaluation", &network.evaluation]);
        self.row(&columns, &[&"initial policy", &network.policy]);
        for (rule, value) in rules(network) {
            self.row(&columns, &[&rule, &value]);
        }
        self.end_table();
    }
}

fn of(findings: &[Finding], severity: Severity) -> Vec<&Finding> {
    let is = |finding: &&Finding| finding.severity == severity;
    findings.iter().filter(is).collect()
}

/// The rules, with spaces for underscores.
fn rules(network: &NetworkSummary) -> Vec<(String, String)> {
    let Ok(serde_json::Value::Object(rules)) = serde_json::to_value(&network.rules) else {
        return Vec::new();
    };
    let name = |rule: String| format!("rule: {}", rule.replace('_', " "));
    let value = |value: serde_json::Value| match value {
        serde_json::Value::String(text) => text,
        other => other.to_string(),
    };
    rules
        .into_iter()
        .map(|(rule, reports)| (name(rule), value(reports)))
        .collect()
}
