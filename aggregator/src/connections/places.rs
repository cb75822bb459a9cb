//! Who holds a place among a server's connections. While all places are taken, a stranger's connection makes room for a new one:
//! [`crate::connections::crowds`] says which. A node's place is never taken away.

use crate::connections::crowds::{makes_room, Stranger};
use crate::connections::limits::{ConnectionLimits, PLACES_PER_NODE};
use std::collections::{BTreeMap, BTreeSet};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use tokio::sync::{Notify, Semaphore};
use tokio::time::Instant;
use zk0_circuits::NodeId;

/// Why a connection gets no place.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub(crate) enum NoPlace {
    /// Nodes hold all places of the address.
    #[error("{address} has {most} connections, and nodes hold all of them: allow more with --max-connections-per-address")]
    OfAddress { address: IpAddr, most: usize },
    /// No connection makes room.
    #[error(
        "all {most} connections are taken, and nodes hold them: allow more with --max-connections"
    )]
    AtAll { most: usize },
}

/// How many connections there are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Counts {
    /// Connections of nodes.
    pub of_nodes: u64,
    /// The nodes that they are of.
    pub nodes: u64,
    /// Connections of strangers.
    pub of_strangers: u64,
}

/// The places of one server.
pub(crate) struct ConnectionSlots {
    limits: ConnectionLimits,
    held: Mutex<Held>,
}

#[derive(Default)]
struct Held {
    next: u64,
    places: BTreeMap<u64, TrackedConnection>,
    /// For the large messages of each node. It is here as long as somebody waits for it, or has it.
    turns: BTreeMap<NodeId, Weak<Semaphore>>,
}

/// What is known of a connection.
struct TrackedConnection {
    /// The address that counts: an IPv6 network stands for all its addresses.
    from: IpAddr,
    /// Whose place it is, if a node keeps it.
    node: Option<NodeId>,
    requests: usize,
    came: Instant,
    /// When the connection came, or a request last began or ended.
    active: Instant,
    evicted: Arc<Notify>,
    /// For the large messages of strangers at this address. All connections of an address share it.
    large: Arc<Semaphore>,
}

/// A connection's place, until it is dropped.
pub(crate) struct Seat {
    pub(super) number: u64,
    pub(super) places: Arc<ConnectionSlots>,
    pub(super) large: Arc<Semaphore>,
    evicted: Arc<Notify>,
}

impl ConnectionSlots {
    pub fn new(limits: ConnectionLimits) -> Arc<Self> {
        Arc::new(Self {
            limits,
            held: Mutex::default(),
        })
    }

    /// Takes a place for a connection from `address`. Another connection may have to make room.
    pub fn enter(self: &Arc<Self>, address: IpAddr) -> Result<Seat, NoPlace> {
        let place = self.held().enter(&self.limits, address, Instant::now())?;
        let (number, evicted, large) = place;
        Ok(Seat {
            number,
            places: self.clone(),
            large,
            evicted,
        })
    }

    /// The connection `number` is this node's from now on, unless nodes hold as many places as they can. Returns whether it is.
    pub fn keep(&self, number: u64, node: NodeId) -> bool {
        let mut held = self.held();
        let of_nodes = held.places.values().filter(|place| place.node.is_some());
        let full = of_nodes.count() >= self.limits.most_of_nodes();
        match held.places.get(&number) {
            None => return false,
            Some(place) if place.node == Some(node) => return true,
            Some(place) if place.node.is_none() && full => return false,
            Some(_) => {}
        }
        let own = |place: &TrackedConnection| place.node == Some(node);
        if held.places.values().filter(|place| own(place)).count() >= PLACES_PER_NODE {
            if let Some(idle) = held.idlest(own) {
                held.places
                    .entry(idle)
                    .and_modify(|place| place.node = None);
            }
        }
        let place = held.places.entry(number);
        place.and_modify(|place| place.node = Some(node));
        true
    }

    /// Whose place the connection `number` has.
    pub fn node(&self, number: u64) -> Option<NodeId> {
        self.held().places.get(&number)?.node
    }

    /// The turn for large messages of the node whose place the connection `number` has. A node has one, whatever connections it has: what it
    /// has reserved counts to it although the connection becomes a stranger's meanwhile.
    pub fn turn_of_node(&self, number: u64) -> Option<Arc<Semaphore>> {
        let mut held = self.held();
        let node = held.places.get(&number)?.node?;
        Some(held.turn_of(node))
    }

    /// How many connections there are now.
    pub fn counts(&self) -> Counts {
        let held = self.held();
        let of_nodes = held.places.values().filter_map(|place| place.node);
        let nodes: BTreeSet<_> = of_nodes.clone().collect();
        let of_nodes = of_nodes.count();
        Counts {
            of_nodes: of_nodes as u64,
            nodes: nodes.len() as u64,
            of_strangers: (held.places.len() - of_nodes) as u64,
        }
    }

    /// A request of the connection `number` begins.
    pub fn begin(&self, number: u64) {
        self.change(number, |place| place.requests += 1);
    }

    /// A request of the connection `number` has ended.
    pub fn end(&self, number: u64) {
        self.change(number, |place| {
            place.requests = place.requests.saturating_sub(1)
        });
    }

    fn change(&self, number: u64, change: impl FnOnce(&mut TrackedConnection)) {
        if let Some(place) = self.held().places.get_mut(&number) {
            change(place);
            place.active = Instant::now();
        }
    }

    /// When the connection `number` has been idle for too long; `None` while it has a request in progress.
    pub fn idle_until(&self, number: u64) -> Option<Instant> {
        let held = self.held();
        let place = held.places.get(&number)?;
        let idle = match place.node {
            Some(_) => self.limits.node_idle,
            None => self.limits.stranger_idle,
        };
        (place.requests == 0).then(|| place.active + idle)
    }

    /// A panic elsewhere does not spoil the places: they are never half changed.
    fn held(&self) -> MutexGuard<'_, Held> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Held {
    /// Takes a place for a connection that comes from `address` at `now`. Returns its number, what tells it that it has to make room, and
    /// the turn for large messages of strangers at this address.
    fn enter(
        &mut self,
        limits: &ConnectionLimits,
        address: IpAddr,
        now: Instant,
    ) -> Result<(u64, Arc<Notify>, Arc<Semaphore>), NoPlace> {
        let from = counted(address);
        let neighbours = self.places.values().filter(|place| place.from == from);
        let large = neighbours.clone().next().map(|place| place.large.clone());
        let (most, here) = (limits.per_address, is_here(address));
        let crowded = !here && neighbours.count() >= most;
        if crowded && !self.evict(from, now, |place| place.from == from) {
            return Err(NoPlace::OfAddress { address, most });
        }
        let most = limits.most;
        if self.places.len() >= most && !self.evict(from, now, |_| true) {
            return Err(NoPlace::AtAll { most });
        }
        let large = large.unwrap_or_else(|| {
            let at_once = if here { Semaphore::MAX_PERMITS } else { 1 };
            Arc::new(Semaphore::new(at_once))
        });
        let (number, evicted) = (self.next, Arc::new(Notify::new()));
        self.next += 1;
        let place = TrackedConnection {
            from,
            node: None,
            requests: 0,
            came: now,
            active: now,
            evicted: evicted.clone(),
            large: large.clone(),
        };
        self.places.insert(number, place);
        Ok((number, evicted, large))
    }

    /// Of these connections, the one that has been idle longest.
    fn idlest(&self, among: impl Fn(&TrackedConnection) -> bool) -> Option<u64> {
        let places = self.places.iter().filter(|(_, place)| among(place));
        let idlest = places.min_by_key(|(_, place)| (place.requests > 0, place.active));
        idlest.map(|(number, _)| *number)
    }

    /// Takes the place of a stranger among these connections, for one that comes from `newcomer`. Returns whether there was one.
    fn evict(
        &mut self,
        newcomer: IpAddr,
        now: Instant,
        among: impl Fn(&TrackedConnection) -> bool,
    ) -> bool {
        let places = self.places.iter();
        let places = places.filter(|(_, place)| place.node.is_none() && among(place));
        let strangers = places.map(|(number, place)| Stranger {
            number: *number,
            from: place.from,
            came: place.came,
            requests: place.requests,
            active: place.active,
        });
        let evicted = makes_room(strangers.collect(), newcomer, now);
        match evicted.and_then(|number| self.places.remove(&number)) {
            Some(place) => {
                place.evicted.notify_one();
                true
            }
            None => false,
        }
    }

    /// The turn of this node for its large messages.
    fn turn_of(&mut self, node: NodeId) -> Arc<Semaphore> {
        if let Some(turn) = self.turns.get(&node).and_then(Weak::upgrade) {
            return turn;
        }
        self.turns.retain(|_, turn| turn.strong_count() > 0);
        let turn = Arc::new(Semaphore::new(1));
        self.turns.insert(node, Arc::downgrade(&turn));
        turn
    }
}

impl Seat {
    /// Ready when somebody else has got this place.
    pub async fn evicted(&self) {
        self.evicted.notified().await;
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        self.places.held().places.remove(&self.number);
    }
}

/// The address that counts. Whoever has one IPv6 address usually has a network of 64 bits.
fn counted(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) => {
            let network = u128::from(address) >> 64 << 64;
            Ipv6Addr::from(network).into()
        }
        v4 => v4,
    }
}

/// Whether a connection comes from this machine itself. It may be a proxy, behind which everybody comes from this one address.
fn is_here(address: IpAddr) -> bool {
    let address = address.to_canonical();
    address == Ipv4Addr::LOCALHOST || address == Ipv6Addr::LOCALHOST
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;
    use tokio::time::sleep;

    const NODE: NodeId = NodeId([1; 32]);

    fn places(most: usize, per_address: usize) -> Arc<ConnectionSlots> {
        ConnectionSlots::new(ConnectionLimits {
            most,
            per_address,
            ..ConnectionLimits::default()
        })
    }

    fn from(last: u8) -> IpAddr {
        IpAddr::from([192, 0, 2, last])
    }

    /// Takes a place a little later than whatever came before.
    async fn enter(places: &Arc<ConnectionSlots>, address: u8) -> Seat {
        sleep(Duration::from_millis(2)).await;
        places.enter(from(address)).unwrap()
    }

    fn is_in(seat: &Seat) -> bool {
        seat.places.held().places.contains_key(&seat.number)
    }

    #[test]
    fn the_stranger_that_has_been_idle_longest_makes_room() {
        let limits = ConnectionLimits {
            most: 3,
            ..ConnectionLimits::default()
        };
        let (mut held, start) = (Held::default(), Instant::now());
        let at = |seconds| start + Duration::from_secs(seconds);
        let enter = |held: &mut Held, last, seconds| {
            let entered = held.enter(&limits, from(last), at(seconds));
            entered.unwrap().0
        };
        let [first, second, third] = [1, 2, 3].map(|last| enter(&mut held, last, last.into()));
        // The first has asked something since.
        held.places
            .entry(first)
            .and_modify(|place| place.active = at(10));
        let fourth = enter(&mut held, 4, 20);
        let there: Vec<_> = held.places.keys().copied().collect();
        assert_eq!(there, [first, third, fourth], "{second} made room");
        // A request in progress keeps its connection, if others are idle.
        held.places
            .entry(third)
            .and_modify(|place| place.requests = 1);
        let fifth = enter(&mut held, 5, 40);
        let there: Vec<_> = held.places.keys().copied().collect();
        assert_eq!(there, [third, fourth, fifth], "{first} made room");
    }

    #[tokio::test]
    async fn whoever_makes_room_is_told() {
        let places = places(1, 16);
        let first = enter(&places, 1).await;
        let _second = enter(&places, 2).await;
        assert!(!is_in(&first));
        first.evicted().await;
    }

    #[test]
    fn an_address_with_all_its_connections_takes_no_place_of_others() {
        let limits = ConnectionLimits {
            most: 17,
            ..ConnectionLimits::default()
        };
        let (mut held, start) = (Held::default(), Instant::now());
        let (honest, ..) = held.enter(&limits, from(1), start).unwrap();
        let later = start + Duration::from_secs(20);
        let attacker = IpAddr::from([198, 51, 100, 1]);
        let neighbour = IpAddr::from([198, 51, 100, 2]);
        for at in 0..100 {
            let address = if at % 2 == 0 { attacker } else { neighbour };
            let (number, ..) = held.enter(&limits, address, later).unwrap();
            held.places
                .entry(number)
                .and_modify(|place| place.requests = 1);
        }
        assert!(held.places.contains_key(&honest));
        assert_eq!(held.places.len(), limits.most);
    }

    #[tokio::test]
    async fn a_node_has_one_turn_for_all_its_connections() {
        let places = places(16, 16);
        let (first, second) = (enter(&places, 1).await, enter(&places, 2).await);
        let third = enter(&places, 3).await;
        assert!(places.turn_of_node(first.number).is_none());
        for (seat, node) in [(&first, 1), (&second, 1), (&third, 2)] {
            assert!(places.keep(seat.number, NodeId([node; 32])));
        }
        let turns = [&first, &second, &third].map(|seat| places.turn_of_node(seat.number).unwrap());
        assert!(Arc::ptr_eq(&turns[0], &turns[1]) && !Arc::ptr_eq(&turns[0], &turns[2]));
        let had = turns[0].clone().try_acquire_owned();
        // The connection is a stranger's from now on, and what it has counts to the node.
        let fourth = enter(&places, 4).await;
        assert!(places.keep(fourth.number, NODE));
        assert!(places.turn_of_node(first.number).is_none());
        let turn = places.turn_of_node(fourth.number).unwrap();
        assert!(turn.clone().try_acquire_owned().is_err());
        drop((had, turn, turns));
        // Nobody has a turn, so no node is remembered but the one that asks.
        assert!(places.turn_of_node(third.number).is_some());
        assert_eq!(places.held().turns.len(), 1);
    }

    #[tokio::test]
    async fn a_node_keeps_its_place_and_strangers_keep_some() {
        let places = places(3, 16);
        let seats = [
            enter(&places, 1).await,
            enter(&places, 2).await,
            enter(&places, 3).await,
        ];
        let kept = |at: usize| places.keep(seats[at].number, NodeId([at as u8; 32]));
        // One of three places stays open to strangers.
        assert_eq!([kept(0), kept(1), kept(2)], [true, true, false]);
        let stranger = enter(&places, 4).await;
        let other = enter(&places, 5).await;
        assert_eq!([0, 1, 2].map(|at| is_in(&seats[at])), [true, true, false]);
        assert_eq!([&stranger, &other].map(is_in), [false, true]);
    }

    #[tokio::test]
    async fn a_node_keeps_two_places() {
        let places = places(16, 16);
        let seats = [
            enter(&places, 1).await,
            enter(&places, 1).await,
            enter(&places, 1).await,
        ];
        for seat in &seats {
            assert!(places.keep(seat.number, NODE));
        }
        let nodes = seats.each_ref().map(|seat| places.node(seat.number));
        assert_eq!(nodes, [None, Some(NODE), Some(NODE)]);
    }

    #[tokio::test]
    async fn an_address_makes_room_among_its_own_connections() {
        let places = places(16, 2);
        let elsewhere = enter(&places, 9).await;
        let first = enter(&places, 1).await;
        let second = enter(&places, 1).await;
        let third = enter(&places, 1).await;
        assert_eq!(
            [&elsewhere, &first, &second].map(is_in),
            [true, false, true]
        );
        for (seat, node) in [(&second, 1), (&third, 2)] {
            assert!(places.keep(seat.number, NodeId([node; 32])));
        }
        let refused = places.enter(from(1)).err();
        let address = from(1);
        assert_eq!(refused, Some(NoPlace::OfAddress { address, most: 2 }));
        drop(third);
        assert!(places.enter(from(1)).is_ok());
    }

    #[tokio::test]
    async fn this_machine_may_have_any_number_of_connections() {
        let places = places(16, 2);
        for here in ["127.0.0.1", "::1"] {
            let address = here.parse().unwrap();
            let seats: Vec<_> = (0..5).map(|_| places.enter(address).unwrap()).collect();
            assert!(seats.iter().all(is_in), "{here}");
        }
    }

    #[test]
    fn an_ipv6_network_counts_as_one_address() {
        let ip = |text: &str| counted(text.parse().unwrap());
        assert_eq!(ip("2001:db8::1"), ip("2001:db8::ffff:2"));
        assert_ne!(ip("2001:db8::1"), ip("2001:db8:0:1::1"));
        assert_eq!(ip("::ffff:192.0.2.1"), from(1));
    }
}
