//! Who holds a place among a server's connections.

use crate::connections::crowds::{makes_room, TrackedConnection};
use crate::connections::limits::ConnectionLimits;
use prometheus_client::metrics::gauge::Gauge;
use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::{Notify, Semaphore};
use tokio::time::Instant;

pub(crate) struct ConnectionSlots {
    most: usize,
    idle: Duration,
    held: Mutex<Held>,
    /// Counts the connections, also those told to make room.
    open: Gauge,
}

#[derive(Default)]
struct Held {
    next: u64,
    /// Each connection, and what tells it to make room.
    places: BTreeMap<u64, (TrackedConnection, Arc<Notify>)>,
}

/// A connection's place, until it is dropped.
pub(crate) struct Seat {
    number: u64,
    from: IpAddr,
    places: Arc<ConnectionSlots>,
    evicted: Arc<Notify>,
}

/// The connection of a request, among its extensions. It outlives the connection.
#[derive(Clone)]
pub(crate) struct ServedConnection {
    number: u64,
    /// The address that counts.
    pub from: IpAddr,
    places: Arc<ConnectionSlots>,
    pub(super) turns: Arc<Semaphore>,
}

pub(crate) struct InProgress(ServedConnection);

impl ConnectionSlots {
    /// The places of `limits`. `open` counts the connections.
    pub fn new(limits: &ConnectionLimits, open: Gauge) -> Arc<Self> {
        Arc::new(Self {
            most: limits.most,
            idle: limits.idle,
            held: Mutex::default(),
            open,
        })
    }

    /// Takes a place. Another connection may have to make room.
    pub fn enter(self: &Arc<Self>, address: IpAddr) -> Seat {
        let from = counted(address);
        let (number, evicted) = self.held().enter(self.most, from, Instant::now());
        self.open.inc();
        Seat {
            number,
            from,
            places: self.clone(),
            evicted,
        }
    }

    fn change(&self, number: u64, change: impl FnOnce(&mut TrackedConnection)) {
        if let Some((place, _)) = self.held().places.get_mut(&number) {
            change(place);
            place.active = Instant::now();
        }
    }

    /// A panic elsewhere leaves the places whole.
    fn held(&self) -> MutexGuard<'_, Held> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Held {
    /// Takes a place among `most`. Returns its number, and what tells it to make room.
    fn enter(&mut self, most: usize, from: IpAddr, now: Instant) -> (u64, Arc<Notify>) {
        if self.places.len() >= most {
            let places = self.places.values().map(|(place, _)| *place);
            let gone = makes_room(places.collect(), from, now);
            if let Some((_, evicted)) = gone.and_then(|number| self.places.remove(&number)) {
                evicted.notify_one();
            }
        }
        let (number, evicted) = (self.next, Arc::new(Notify::new()));
        self.next += 1;
        let place = TrackedConnection {
            number,
            from,
            came: now,
            requests: 0,
            active: now,
        };
        self.places.insert(number, (place, evicted.clone()));
        (number, evicted)
    }
}

impl Seat {
    /// Ready when another connection got this place.
    pub async fn evicted(&self) {
        self.evicted.notified().await;
    }

    /// The connection as its requests see it, with at most `requests` in progress.
    pub fn connection(&self, requests: usize) -> ServedConnection {
        ServedConnection {
            number: self.number,
            from: self.from,
            places: self.places.clone(),
            turns: Arc::new(Semaphore::new(requests)),
        }
    }

    /// When the connection will have idled too long; `None` during a request.
    pub fn idle_until(&self) -> Option<Instant> {
        let held = self.places.held();
        let (place, _) = held.places.get(&self.number)?;
        (place.requests == 0).then(|| place.active + self.places.idle)
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        self.places.held().places.remove(&self.number);
        self.places.open.dec();
    }
}

impl ServedConnection {
    pub fn begin(&self) -> InProgress {
        self.places.change(self.number, |place| place.requests += 1);
        InProgress(self.clone())
    }
}

impl Drop for InProgress {
    fn drop(&mut self) {
        let ServedConnection { places, number, .. } = &self.0;
        places.change(*number, |place| place.requests -= 1);
    }
}

/// The address that counts: IPv6 usually comes by the /64.
fn counted(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) if address != Ipv6Addr::LOCALHOST => {
            let network = u128::from(address) >> 64 << 64;
            Ipv6Addr::from(network).into()
        }
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn from(last: u8) -> IpAddr {
        IpAddr::from([192, 0, 2, last])
    }

    #[test]
    fn the_connection_that_has_been_idle_longest_makes_room() {
        let (mut held, start) = (Held::default(), Instant::now());
        let at = |seconds| start + Duration::from_secs(seconds);
        let enter = |held: &mut Held, last, seconds| held.enter(3, from(last), at(seconds)).0;
        let [first, second, third] = [1, 2, 3].map(|last| enter(&mut held, last, last.into()));
        held.places.get_mut(&first).unwrap().0.active = at(10);
        let fourth = enter(&mut held, 4, 20);
        let there: Vec<_> = held.places.keys().copied().collect();
        assert_eq!(there, [first, third, fourth], "{second} made room");
        // A request in progress keeps its connection, if others are idle.
        held.places.get_mut(&third).unwrap().0.requests = 1;
        let fifth = enter(&mut held, 5, 40);
        let there: Vec<_> = held.places.keys().copied().collect();
        assert_eq!(there, [third, fourth, fifth], "{first} made room");
    }

    #[tokio::test]
    async fn whoever_makes_room_is_told_and_a_place_is_free_when_its_connection_ends() {
        let limits = ConnectionLimits {
            most: 1,
            ..ConnectionLimits::default()
        };
        let places = ConnectionSlots::new(&limits, Gauge::default());
        let first = places.enter(from(1));
        let request = first.connection(1).begin();
        assert_eq!(first.idle_until(), None);
        drop(request);
        assert!(first.idle_until().is_some());
        let second = places.enter(from(2));
        first.evicted().await;
        assert!(second.idle_until().is_some());
        assert_eq!(places.open.get(), 2);
        drop((first, second));
        assert_eq!((places.open.get(), places.held().places.len()), (0, 0));
    }

    #[test]
    fn an_address_with_all_its_connections_takes_no_place_of_others() {
        let (mut held, start) = (Held::default(), Instant::now());
        let (honest, _) = held.enter(17, from(1), start);
        let later = start + Duration::from_secs(20);
        for at in 0..100 {
            let address = IpAddr::from([198, 51, 100, at % 2]);
            let (number, _) = held.enter(17, address, later);
            held.places.get_mut(&number).unwrap().0.requests = 1;
        }
        assert!(held.places.contains_key(&honest));
        assert_eq!(held.places.len(), 17);
    }

    #[test]
    fn an_ipv6_network_counts_as_one_address() {
        let ip = |text: &str| counted(text.parse().unwrap());
        assert_eq!(ip("2001:db8::1"), ip("2001:db8::ffff:2"));
        assert_ne!(ip("2001:db8::1"), ip("2001:db8:0:1::1"));
        assert_eq!(ip("::ffff:192.0.2.1"), from(1));
    }
}
