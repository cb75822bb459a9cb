//! Which connection makes room when all places are taken: one of those whose network holds most. An attacker has many connections, but
//! seldom many networks. Idleness shows little: a newcomer is idle until its first request, and an attacker can hold requests at no cost.
//! Senders do not count: behind a proxy, one connection has many.
//!
//! | what counts | for |
//! |---|---|
//! | connections from the same /16 of IPv4, or /48 of IPv6, with the newcomer | the larger crowd makes room |
//! | then those from the same /24, or /56; then from the same address, or /64 | the same |
//! | then whether a connection has come within [`GRACE`] | it stays, while others can make room |
//! | then, if all are so young, when | the first to come makes room |
//! | then requests in progress, and how long there were none | the idlest makes room |
//!
//! Crowds of up to [`FEW`] count as equally large.

use std::cmp::Reverse;
use std::net::IpAddr;
use std::time::Duration;
use tokio::time::Instant;

/// Time for the first request: handshakes take some round trips.
const GRACE: Duration = Duration::from_secs(5);

/// So many are no crowd: two nodes that come at once are not worse than one.
const FEW: usize = 4;

/// Prefix lengths in IPv4 and in IPv6.
type Lengths = (u32, u32);

const WIDE: Lengths = (16, 48);
const MIDDLE: Lengths = (24, 56);
const NARROW: Lengths = (32, 64);

#[derive(Clone, Copy, Debug)]
pub(super) struct TrackedConnection {
    pub number: u64,
    /// The address that counts: an IPv6 network has one.
    pub from: IpAddr,
    pub came: Instant,
    pub requests: usize,
    /// When it came, or a request last began or ended.
    pub active: Instant,
}

/// The number of the connection that makes room at `now` for a newcomer from this address; `None` without connections.
///
/// It sorts all connections, and an attacker can cause that with each new one.
pub(super) fn makes_room(
    mut connections: Vec<TrackedConnection>,
    newcomer: IpAddr,
    now: Instant,
) -> Option<u64> {
    connections.sort_unstable_by_key(|connection| bits(connection.from));
    let size = |crowd: &[TrackedConnection], lengths: Lengths| {
        let newcomers = network(newcomer, lengths);
        let its_own = crowd
            .first()
            .is_some_and(|one| network(one.from, lengths) == newcomers);
        (crowd.len() + usize::from(its_own)).max(FEW)
    };
    let mut first = None;
    for widely in connections.chunk_by(together(WIDE)) {
        for nearer in widely.chunk_by(together(MIDDLE)) {
            for crowd in nearer.chunk_by(together(NARROW)) {
                let sizes = (
                    size(widely, WIDE),
                    size(nearer, MIDDLE),
                    size(crowd, NARROW),
                );
                let ranks = crowd.iter().map(|connection| {
                    (sizes, connection.gives_way(now), Reverse(connection.number))
                });
                first = first.max(ranks.max());
            }
        }
    }
    first.map(|(_, _, Reverse(number))| number)
}

fn together(lengths: Lengths) -> impl Fn(&TrackedConnection, &TrackedConnection) -> bool {
    move |one, other| network(one.from, lengths) == network(other.from, lengths)
}

impl TrackedConnection {
    /// The greatest value among equally large crowds makes room.
    fn gives_way(&self, now: Instant) -> (bool, bool, Reverse<Instant>) {
        if now.saturating_duration_since(self.came) < GRACE {
            (false, false, Reverse(self.came))
        } else {
            (true, self.requests == 0, Reverse(self.active))
        }
    }
}

fn bits(address: IpAddr) -> u128 {
    match address {
        IpAddr::V4(address) => address.to_ipv6_mapped().into(),
        IpAddr::V6(address) => address.into(),
    }
}

fn network(address: IpAddr, (v4, v6): Lengths) -> u128 {
    let length = match address {
        IpAddr::V4(_) => 96 + v4,
        IpAddr::V6(_) => v6,
    };
    bits(address) >> (128 - length) << (128 - length)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::Ipv6Addr;

    /// As many places as a witness has.
    const MOST: usize = 256;
    const ROUND_TRIP_MS: u64 = 150;
    const NEWCOMERS: usize = 50;
    const EVERY_MS: u64 = 2_000;
    /// The attackers' connections are old by then.
    const FIRST_MS: u64 = 20_000;

    #[derive(Default)]
    struct Server {
        next: u64,
        connections: Vec<TrackedConnection>,
    }

    impl Server {
        fn enter(
            &mut self,
            from: IpAddr,
            requests: usize,
            now: Instant,
        ) -> (u64, Option<TrackedConnection>) {
            let mut gone = None;
            if self.connections.len() >= MOST {
                let number = makes_room(self.connections.clone(), from, now).unwrap();
                gone = self.leave(number);
                assert!(gone.is_some());
            }
            let number = self.next;
            self.next += 1;
            self.connections.push(TrackedConnection {
                number,
                from,
                came: now,
                requests,
                active: now,
            });
            (number, gone)
        }

        fn leave(&mut self, number: u64) -> Option<TrackedConnection> {
            let mut places = self.connections.iter();
            let at = places.position(|connection| connection.number == number)?;
            Some(self.connections.remove(at))
        }
    }

    /// How many of 50 honest newcomers are answered, while an attacker at these addresses holds all places with requests. It takes a lost
    /// place back after a round trip, and opens a silent connection each `churn_ms`. A newcomer's request comes after two round trips, its
    /// answer after three.
    fn answered(attackers: &[IpAddr], churn_ms: Option<u64>, honest: IpAddr) -> usize {
        let (mut server, start) = (Server::default(), Instant::now());
        let mut attackers = attackers.iter().copied().cycle();
        let mut attacker = || attackers.next().unwrap();
        for _ in 0..MOST {
            server.enter(attacker(), 1, start);
        }
        let mut again: Vec<(u64, IpAddr)> = vec![];
        let (mut newcomer, mut answers) = (None, 0);
        let end = FIRST_MS + NEWCOMERS as u64 * EVERY_MS;
        for ms in (0..end).step_by(10) {
            let now = start + Duration::from_millis(ms);
            let due = |(at, _): &(u64, IpAddr)| *at <= ms;
            let (come, later): (Vec<_>, Vec<_>) = again.into_iter().partition(due);
            again = later;
            let mut coming: Vec<_> = come.into_iter().map(|(_, from)| (from, 1)).collect();
            if churn_ms.is_some_and(|churn| ms.is_multiple_of(churn)) {
                coming.push((attacker(), 0));
            }
            let comes = ms >= FIRST_MS && ms.is_multiple_of(EVERY_MS);
            coming.extend(comes.then_some((honest, 0)));
            for (from, requests) in coming {
                let (number, gone) = server.enter(from, requests, now);
                let taken = gone.filter(|gone| gone.requests > 0 && gone.from != honest);
                again.extend(taken.map(|gone| (ms + ROUND_TRIP_MS, gone.from)));
                if from == honest {
                    newcomer = Some((number, ms));
                }
            }
            let Some((number, came)) = newcomer else {
                continue;
            };
            if ms == came + 2 * ROUND_TRIP_MS {
                let mut places = server.connections.iter_mut();
                if let Some(place) = places.find(|place| place.number == number) {
                    (place.requests, place.active) = (1, now);
                }
            }
            if ms == came + 3 * ROUND_TRIP_MS {
                answers += usize::from(server.leave(number).is_some());
            }
        }
        answers
    }

    fn ip(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    fn all_are_answered(attackers: &[IpAddr], churn_ms: Option<u64>, honest: &str) {
        assert_eq!(answered(attackers, churn_ms, ip(honest)), NEWCOMERS);
    }

    /// The /64 networks of a /56.
    fn networks() -> Vec<IpAddr> {
        let first = u128::from("2001:db8:7:500::".parse::<Ipv6Addr>().unwrap());
        let network = |at: u128| IpAddr::from(Ipv6Addr::from(first + (at << 64)));
        (0..256).map(network).collect()
    }

    #[test]
    fn sixteen_addresses_that_hold_requests_keep_nobody_out() {
        let v4: Vec<IpAddr> = (1..=16).map(|last| [192, 0, 2, last].into()).collect();
        all_are_answered(&v4, None, "198.51.100.1");
        all_are_answered(&networks()[..16], None, "198.51.100.1");
        // They need not be neighbours.
        let apart: Vec<IpAddr> = (1..=16).map(|first| [first, 0, 2, 1].into()).collect();
        all_are_answered(&apart, None, "198.51.100.1");
    }

    #[test]
    fn silent_connections_of_one_network_that_come_and_go_keep_nobody_out() {
        for honest in ["198.51.100.1", "2001:db8:8::1"] {
            all_are_answered(&networks(), Some(50), honest);
        }
        all_are_answered(&networks(), Some(50), "2001:db8:7:600::");
    }

    #[test]
    fn a_newcomer_has_its_first_round_trips_beside_connections_from_everywhere() {
        let apart: Vec<IpAddr> = (0..=255).map(|second| [11, second, 0, 1].into()).collect();
        all_are_answered(&apart, None, "198.51.100.1");
        all_are_answered(&apart, Some(50), "198.51.100.1");
        // All are young: the first to come makes room.
        all_are_answered(&apart, Some(20), "198.51.100.1");
    }

    fn connection(number: u64, from: &str, came: Instant) -> TrackedConnection {
        TrackedConnection {
            number,
            from: ip(from),
            came,
            requests: 0,
            active: came,
        }
    }

    #[test]
    fn a_crowd_that_comes_and_goes_takes_no_place_of_others() {
        let start = Instant::now();
        let now = start + 4 * GRACE;
        // Long idle, while all others are young and have requests.
        let mut connections = vec![connection(0, "198.51.100.1", start)];
        for number in 1..=16 {
            let mut young = connection(number, "192.0.2.1", now);
            young.requests = 1;
            connections.push(young);
        }
        let gone = makes_room(connections, ip("192.0.2.2"), now);
        assert_eq!(gone, Some(1));
    }

    #[test]
    fn a_newcomer_counts_to_its_own_crowd() {
        let now = Instant::now();
        let crowds = ["192.0.2.1", "198.51.100.1"];
        let connections =
            (0..16).map(|number| connection(number, crowds[number as usize % 2], now));
        let connections: Vec<_> = connections.collect();
        for (newcomer, gone) in [("192.0.2.1", 0), ("198.51.100.1", 1)] {
            assert_eq!(
                makes_room(connections.clone(), ip(newcomer), now),
                Some(gone)
            );
        }
    }

    #[test]
    fn two_nodes_behind_one_address_are_no_crowd() {
        let start = Instant::now();
        let now = start + 2 * GRACE;
        let mut connections: Vec<_> = (0..8)
            .map(|number| connection(number, &format!("11.{number}.0.1"), start))
            .collect();
        connections.push(connection(8, "198.51.100.1", now));
        assert_eq!(makes_room(connections, ip("198.51.100.1"), now), Some(0));
    }

    #[test]
    fn whoever_is_idle_longest_goes_where_crowds_are_equal() {
        let start = Instant::now();
        let now = start + 4 * GRACE;
        let mut connections: Vec<_> = (0..3)
            .map(|number| connection(number, "192.0.2.1", start))
            .collect();
        connections[0].requests = 1;
        connections[1].active = now;
        assert_eq!(makes_room(connections, ip("192.0.2.1"), now), Some(2));
        assert_eq!(makes_room(vec![], ip("192.0.2.1"), now), None);
    }

    #[test]
    fn networks_are_those_of_ipv4_and_of_ipv6() {
        let same = |one: &str, other: &str| {
            let [one, other] = [one, other].map(ip);
            let same = [WIDE, MIDDLE, NARROW].map(|of| network(one, of) == network(other, of));
            same.into_iter().filter(|same| *same).count()
        };
        assert_eq!(same("192.0.2.1", "192.0.2.1"), 3);
        assert_eq!(same("192.0.2.1", "192.0.2.2"), 2);
        assert_eq!(same("192.0.2.1", "192.0.3.1"), 1);
        assert_eq!(same("192.0.2.1", "192.1.2.1"), 0);
        assert_eq!(same("2001:db8:1:101::", "2001:db8:1:101::1"), 3);
        assert_eq!(same("2001:db8:1:101::", "2001:db8:1:102::"), 2);
        assert_eq!(same("2001:db8:1:101::", "2001:db8:1:201::"), 1);
        assert_eq!(same("2001:db8:1:101::", "2001:db8:2:101::"), 0);
    }
}
