//! A program that only reads a log finds the same required witnesses as one that replays it.

use zk0_protocol::entries::proposal::{Action, Ballot, Outcome};
use zk0_protocol::rules::required_witnesses::RequiredWitnesses;
use zk0_protocol::tlog::cosigner::Cosigner;
use zk0_protocol::{Body, Rules};
use zk0_testkit::network::votes::*;
use zk0_testkit::network::*;

/// Rules that ask for this many witnesses.
fn asking(witnesses: u8) -> Rules {
    let names = (0..witnesses).map(|number| {
        let name = format!("witness.example/{number}");
        let cosigner = Cosigner::new(&name, key(number)).unwrap();
        format!("witness W{number} {} http://{name}\n", cosigner.key())
    });
    let policy: String = names.collect();
    Rules {
        witness_policy: match witnesses {
            0 => policy,
            _ => format!("{policy}quorum W0\n"),
        },
        ..genesis().rules
    }
}

#[test]
fn the_witnesses_asked_for_change_with_the_rules_and_not_before() {
    let mut founding = genesis();
    founding.rules = asking(1);
    let mut chain = Chain::founded(founding.clone());
    let mut asked = RequiredWitnesses::default();
    asked.observe(&Body::Genesis(founding));
    let mut seen = Vec::new();
    let mut apply = |chain: &mut Chain, body: Body| {
        asked.observe(&body);
        chain.apply(body);
        let (found, ruled) = (asked.policy().unwrap(), chain.state.rules().witnesses());
        assert_eq!(found.text(), ruled.unwrap().text());
        seen.push(found.witnesses().len());
    };
    let votes = [
        // The first proposal passes, the second is rejected, and the third is about something else.
        (Action::ChangeRules(Box::new(asking(2))), Ballot::For),
        (Action::ChangeRules(Box::new(asking(3))), Ballot::Against),
        (Action::Enrol(enrolment(1)), Ballot::For),
        (Action::ChangeRules(Box::new(asking(0))), Ballot::For),
    ];
    for (number, (action, ballot)) in (0..).zip(votes) {
        let proposal = proposed(&chain.state, 0, action);
        apply(&mut chain, proposal);
        for governor in 0..3 {
            let vote = voted(&chain.state, governor, number, ballot);
            apply(&mut chain, vote);
        }
        chain.wait(VOTING + TIME_LOCK);
        let outcome = match ballot {
            Ballot::For => Outcome::Executed,
            _ => Outcome::Rejected,
        };
        apply(&mut chain, settled(number, outcome));
    }
    let settled: Vec<_> = seen.iter().skip(4).step_by(5).copied().collect();
    assert_eq!(settled, [2, 2, 2, 0]);
    assert_eq!(seen[3], 1, "not before it is settled");
}
