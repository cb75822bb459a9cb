//! Long checks on a bounded number of threads. Outcomes come out in the order of the starts.

use std::collections::VecDeque;
use std::num::NonZeroUsize;
use std::sync::mpsc::{sync_channel, Receiver, TryRecvError};
use std::thread;

/// A queue of checks with outcomes `T`.
pub struct Queue<T> {
    slots: VecDeque<QueueSlot<T>>,
    most: usize,
}

enum QueueSlot<T> {
    Done(T),
    Running(Receiver<T>),
}

impl<T: Send + 'static> Queue<T> {
    /// A queue of at most twice as many checks as `threads`.
    pub fn new(threads: NonZeroUsize) -> Self {
        Self {
            slots: VecDeque::new(),
            most: threads.get().saturating_mul(2),
        }
    }

    /// Starts `check` on another thread. If the queue [is full](Queue::is_full), first take an outcome.
    pub fn begin(&mut self, check: impl FnOnce() -> T + Send + 'static) {
        let (done, outcome) = sync_channel(1);
        // Without a new thread, this thread does the check.
        let check = std::sync::Arc::new(std::sync::Mutex::new(Some(check)));
        let taken = check.clone();
        let run = move || {
            let check = taken.lock().ok().and_then(|mut check| check.take());
            if let Some(check) = check {
                let _ = done.send(check());
            }
        };
        let slot = match thread::Builder::new().spawn(run) {
            Ok(_) => QueueSlot::Running(outcome),
            Err(_) => match check.lock().ok().and_then(|mut check| check.take()) {
                Some(check) => QueueSlot::Done(check()),
                None => QueueSlot::Running(outcome),
            },
        };
        self.slots.push_back(slot);
    }

    /// Adds a known outcome.
    pub fn push(&mut self, outcome: T) {
        self.slots.push_back(QueueSlot::Done(outcome));
    }

    /// Whether an outcome must come out before the next check begins.
    pub fn is_full(&self) -> bool {
        self.slots.len() >= self.most
    }

    /// The first outcome, if ready. An error if its thread panicked.
    pub fn take_ready(&mut self) -> Option<Result<T, Panicked>> {
        let outcome = match self.slots.front()? {
            QueueSlot::Done(_) => return self.take(),
            QueueSlot::Running(outcome) => match outcome.try_recv() {
                Ok(outcome) => Ok(outcome),
                Err(TryRecvError::Disconnected) => Err(Panicked),
                Err(TryRecvError::Empty) => return None,
            },
        };
        self.slots.pop_front();
        Some(outcome)
    }

    /// Waits for the first outcome.
    pub fn take(&mut self) -> Option<Result<T, Panicked>> {
        Some(match self.slots.pop_front()? {
            QueueSlot::Done(outcome) => Ok(outcome),
            QueueSlot::Running(outcome) => outcome.recv().map_err(|_| Panicked),
        })
    }
}

/// A check's thread panicked, without an outcome.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Panicked;

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::sync::Arc;
    use std::time::Duration;

    #[test]
    fn outcomes_come_in_order_and_no_more_run_than_allowed() {
        let mut queue = Queue::new(NonZeroUsize::new(2).unwrap());
        let running = Arc::new(AtomicUsize::new(0));
        let (mut out, mut most) = (Vec::new(), 0);
        for number in 0..40u64 {
            while queue.is_full() {
                out.push(queue.take().unwrap().unwrap());
            }
            let running = running.clone();
            if number % 5 == 0 {
                queue.push((number, 0));
                continue;
            }
            queue.begin(move || {
                let now = running.fetch_add(1, Ordering::SeqCst) + 1;
                thread::sleep(Duration::from_millis((40 - number) % 7));
                running.fetch_sub(1, Ordering::SeqCst);
                (number, now)
            });
        }
        while let Some(outcome) = queue.take() {
            out.push(outcome.unwrap());
        }
        for (_, now) in &out {
            most = most.max(*now);
        }
        let order: Vec<_> = out.iter().map(|(number, _)| *number).collect();
        assert_eq!(order, (0..40).collect::<Vec<_>>());
        assert!((2..=4).contains(&most), "{most} at once");
    }

    #[test]
    fn a_check_that_panics_has_no_outcome() {
        let mut queue: Queue<()> = Queue::new(NonZeroUsize::MIN);
        queue.begin(|| panic!("as a test"));
        assert_eq!(queue.take(), Some(Err(Panicked)));
        assert_eq!(queue.take(), None);
    }
}
