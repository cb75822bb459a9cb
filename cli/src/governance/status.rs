//! What `zk0 governance status` prints.

use anyhow::Result;
use zk0_audit::report::describe;
use zk0_node::client::GovernanceInfo;
use zk0_protocol::entries::proposal::Action;
use zk0_protocol::entries::signed::Proposal;
use zk0_protocol::rpc::federation::OpenProposal;

/// The rules, the guest program, and open proposals.
pub fn status(info: &GovernanceInfo) -> Result<String> {
    let mut text = serde_json::to_string_pretty(&info.rules)? + "\n\n";
    text.push_str(&format!("guest program: {}\n\n", info.program));
    if info.not_cosigned {
        text.push_str(
            "not cosigned: too few witnesses cosign, so not all of this is published\n\n",
        );
    }
    if info.proposals.is_empty() {
        text.push_str("no proposal is open\n");
    }
    for (open, votes) in &info.proposals {
        text.push_str(&proposal(open, votes, info.now_ms)?);
    }
    Ok(text)
}

/// An open proposal and its votes.
pub fn proposal(proposal: &Proposal, open: &OpenProposal, now_ms: u64) -> Result<String> {
    let left = |until: u64| format!("{} s", until.saturating_sub(now_ms).div_ceil(1000));
    let phase = match now_ms {
        now if now <= open.voting_ends_ms => {
            format!("votes are taken for another {}", left(open.voting_ends_ms))
        }
        now if now <= open.veto_ends_ms => {
            format!("vetoes are taken for another {}", left(open.veto_ends_ms))
        }
        _ => "it is settled before the next round opens".into(),
    };
    let mut text = format!(
        "proposal {}: {}\n  {}\n  digest {}\n  by {}; {phase}\n  for {}, against {}, abstained {}, vetoes {}, of {}\n",
        proposal.number,
        describe::printable(&proposal.title),
        describe::printable(&would(&proposal.action)?),
        proposal.digest(),
        proposal.proposer,
        open.for_it,
        open.against,
        open.abstained,
        open.vetoes,
        open.electorate,
    );
    if !proposal.text.is_empty() {
        let shown = proposal.text.escape_debug().to_string();
        text.push_str(&format!("  {shown}\n"));
    }
    Ok(text)
}

/// New rules are shown whole.
fn would(action: &Action) -> Result<String> {
    Ok(match action {
        Action::ChangeRules(rules) => format!("rules: {}", serde_json::to_string(rules)?),
        other => describe::action(other),
    })
}
