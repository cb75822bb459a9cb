//! Row 16. Strangers open as many connections as the service has places for, state nothing more, and keep nodes out.

use super::crowds::{is_answered, with_places};
use crate::attacks::attack::{over_the_network, Attack, Defence, Outcome, Proof};
use std::time::Duration;
use zk0_testkit::aggregator::SigningNode;
use zk0_testkit::changed_copy::SourceChange;
use zk0_testkit::sockets::{closed, speaking};

pub const ATTACK: Attack = Attack {
    number: 16,
    name: "strangers take all connections of the service, and keep them",
    module: module_path!(),
    reason: "a node was answered, and 1 idle connections had to make room",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "another connection makes room for a new one",
        out: &[SourceChange {
            file: "aggregator/src/connections/places.rs",
            replacements: &[(
                "            if let Some((_, evicted)) = gone.and_then(|number| self.places.remove(&number)) {\n",
                "            if OUT {
                let evicted = Arc::new(Notify::new());
                evicted.notify_one();
                return (u64::MAX, evicted);
            }
            if let Some((_, evicted)) = gone.and_then(|number| self.places.remove(&number)) {\n",
            )],
        }],
    },
    carry_out: || over_the_network(carry_out()),
};

const PLACES: usize = 8;
/// How long a node tries.
const PATIENCE: Duration = Duration::from_secs(15);

async fn carry_out() -> Outcome {
    let node = SigningNode::new(1);
    let network = with_places(&node, PLACES).await;
    let mut crowd = Vec::new();
    for host in 1..=PLACES as u8 {
        // From addresses of their own, so that no limit of an address stops them.
        crowd.push(speaking([1, host], &network.address).await);
    }
    let answered = is_answered(network.address.clone(), PATIENCE).await;
    let mut gone = 0;
    for stream in &mut crowd {
        gone += usize::from(closed(stream).await);
    }
    match answered {
        true => Outcome::Refused(format!(
            "a node was answered, and {gone} idle connections had to make room"
        )),
        false => Outcome::Succeeded(format!(
            "{} idle connections of strangers are all that the service has, and no node gets in",
            crowd.len()
        )),
    }
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
