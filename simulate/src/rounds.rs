//! The rounds of a federation. Nodes train in parallel, and updates are added in the nodes' order. The number of threads limits the updates
//! in memory, and does not change the result.

use rand::seq::index;
use rand::SeedableRng;
use rand_chacha::ChaCha20Rng;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, PoisonError};
use std::thread;

/// Nodes, and how their updates are combined.
pub trait Federation: Sync {
    /// What a round starts from.
    type Global: Sync;
    /// What a node sends.
    type Update: Send;
    /// A round's updates so far: their sum, or all if the strategy needs all.
    type Collected: Send;
    /// Why a round cannot go on.
    type Error: Send;

    /// Trains node `node` from `global` in round `round`.
    ///
    /// # Errors
    /// The node cannot train.
    fn train(
        &self,
        round: u64,
        node: usize,
        global: &Self::Global,
    ) -> Result<Self::Update, Self::Error>;

    /// No updates yet.
    fn begin(&self, global: &Self::Global) -> Self::Collected;

    /// Adds a node's update, in ascending order.
    ///
    /// # Errors
    /// The update cannot be added.
    fn add(
        &self,
        collected: &mut Self::Collected,
        node: usize,
        update: Self::Update,
    ) -> Result<(), Self::Error>;

    /// What the next round starts from.
    ///
    /// # Errors
    /// The updates cannot be combined.
    fn combine(
        &self,
        global: Self::Global,
        collected: Self::Collected,
    ) -> Result<Self::Global, Self::Error>;
}

struct UpdateTurns<F: Federation> {
    next: usize,
    collected: F::Collected,
    failed: Option<F::Error>,
}

/// Makes round `round` with these nodes, in ascending order, on `threads` threads.
///
/// # Errors
/// The first error. After it, no further node begins.
pub fn round<F: Federation>(
    federation: &F,
    round: u64,
    nodes: &[usize],
    global: F::Global,
    threads: usize,
) -> Result<F::Global, F::Error> {
    let taken = AtomicUsize::new(0);
    let turns = Mutex::new(UpdateTurns::<F> {
        next: 0,
        collected: federation.begin(&global),
        failed: None,
    });
    let moved = Condvar::new();
    let base = &global;
    let work = || {
        while let Some((place, node)) = take(&taken, nodes) {
            let trained = federation.train(round, node, base);
            let mut turns = turns.lock().unwrap_or_else(PoisonError::into_inner);
            while turns.next < place && turns.failed.is_none() {
                turns = moved.wait(turns).unwrap_or_else(PoisonError::into_inner);
            }
            if turns.failed.is_some() {
                return;
            }
            let added =
                trained.and_then(|update| federation.add(&mut turns.collected, node, update));
            turns.next += 1;
            turns.failed = added.err();
            moved.notify_all();
            if turns.failed.is_some() {
                return;
            }
        }
    };
    thread::scope(|scope| {
        for _ in 1..threads.min(nodes.len()) {
            scope.spawn(work);
        }
        work();
    });
    let turns = turns.into_inner().unwrap_or_else(PoisonError::into_inner);
    match turns.failed {
        Some(error) => Err(error),
        None => federation.combine(global, turns.collected),
    }
}

/// Calls `work` with each number below `count` on `threads` threads. Results are in order.
///
/// # Errors
/// One of the errors. After it, no further work begins.
pub fn parallel<T: Send, E: Send>(
    count: usize,
    threads: usize,
    work: impl Fn(usize) -> Result<T, E> + Sync,
) -> Result<Vec<T>, E> {
    let (next, failed) = (AtomicUsize::new(0), AtomicBool::new(false));
    let some = || {
        let mut done = Vec::new();
        while !failed.load(Ordering::Relaxed) {
            let number = next.fetch_add(1, Ordering::Relaxed);
            if number >= count {
                break;
            }
            match work(number) {
                Ok(value) => done.push((number, value)),
                Err(error) => {
                    failed.store(true, Ordering::Relaxed);
                    return Err(error);
                }
            }
        }
        Ok(done)
    };
    let all = thread::scope(|scope| {
        let others: Vec<_> = (1..threads.min(count)).map(|_| scope.spawn(some)).collect();
        let mut all = vec![some()];
        for other in others {
            all.push(other.join().unwrap_or_else(|panic| resume_unwind(panic)));
        }
        all
    });
    let mut done = Vec::with_capacity(count);
    for some in all {
        done.extend(some?);
    }
    done.sort_by_key(|(number, _)| *number);
    Ok(done.into_iter().map(|(_, value)| value).collect())
}

fn take(taken: &AtomicUsize, nodes: &[usize]) -> Option<(usize, usize)> {
    let place = taken.fetch_add(1, Ordering::Relaxed);
    nodes.get(place).map(|node| (place, *node))
}

/// The nodes in a round, in ascending order: a share, at least one, that `seed` and the round choose.
pub fn sample(nodes: usize, share: f64, seed: u64, round: u64) -> Vec<usize> {
    let count = ((nodes as f64 * share).ceil() as usize).clamp(1, nodes.max(1));
    if count >= nodes {
        return (0..nodes).collect();
    }
    let mut rng = ChaCha20Rng::seed_from_u64(seed);
    rng.set_stream(round);
    let mut chosen = index::sample(&mut rng, nodes, count).into_vec();
    chosen.sort_unstable();
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    struct Letters {
        fails: Option<usize>,
        begun: AtomicUsize,
    }

    impl Federation for Letters {
        type Global = Vec<usize>;
        type Update = usize;
        type Collected = Vec<usize>;
        type Error = usize;

        fn train(&self, _: u64, node: usize, global: &Vec<usize>) -> Result<usize, usize> {
            self.begun.fetch_add(1, Ordering::SeqCst);
            // Earlier nodes take longer.
            thread::sleep(Duration::from_millis(20_u64.saturating_sub(node as u64)));
            match self.fails {
                Some(failing) if failing == node => Err(node),
                _ => Ok(100 * global.len() + node),
            }
        }

        fn begin(&self, _: &Vec<usize>) -> Vec<usize> {
            Vec::new()
        }

        fn add(&self, collected: &mut Vec<usize>, _: usize, update: usize) -> Result<(), usize> {
            collected.push(update);
            Ok(())
        }

        fn combine(&self, _: Vec<usize>, collected: Vec<usize>) -> Result<Vec<usize>, usize> {
            Ok(collected)
        }
    }

    fn letters(fails: Option<usize>) -> Letters {
        Letters {
            fails,
            begun: AtomicUsize::new(0),
        }
    }

    #[test]
    fn updates_are_added_in_the_order_of_the_nodes() {
        let nodes: Vec<_> = (0..12).collect();
        for threads in [1, 2, 5, 40] {
            let result = round(&letters(None), 0, &nodes, vec![0, 0], threads);
            let expected: Vec<_> = nodes.iter().map(|node| 200 + node).collect();
            assert_eq!(result, Ok(expected), "{threads}");
        }
    }

    #[test]
    fn results_come_in_the_order_of_the_numbers() {
        for threads in [1, 3, 20] {
            let squares = parallel(10, threads, |number| Ok::<_, ()>(number * number));
            assert_eq!(squares, Ok((0..10).map(|number| number * number).collect()));
            let none = parallel(10, threads, |number| match number {
                4 => Err("four"),
                _ => Ok(number),
            });
            assert_eq!(none, Err("four"));
        }
        assert_eq!(parallel(0, 2, |_| Ok::<_, ()>(())), Ok(vec![]));
    }

    #[test]
    fn a_round_ends_with_the_first_error() {
        let nodes: Vec<_> = (0..1000).collect();
        let failing = letters(Some(3));
        assert_eq!(round(&failing, 0, &nodes, vec![], 4), Err(3));
        assert!(failing.begun.load(Ordering::SeqCst) < 20);
    }

    #[test]
    fn a_share_of_the_nodes_is_chosen_anew_each_round() {
        assert_eq!(sample(5, 1.0, 0, 0), [0, 1, 2, 3, 4]);
        assert_eq!(sample(100, 0.001, 0, 0).len(), 1);
        let chosen = sample(100, 0.1, 7, 3);
        assert_eq!(chosen.len(), 10);
        assert!(chosen.windows(2).all(|pair| pair[0] < pair[1]));
        assert_eq!(sample(100, 0.1, 7, 3), chosen);
        assert_ne!(sample(100, 0.1, 7, 4), chosen);
        assert_ne!(sample(100, 0.1, 8, 3), chosen);
    }
}
