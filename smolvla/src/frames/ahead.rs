//! Makes samples in the background, before their steps.
//!
//! [`ahead`] gives its work a source of the same samples. When the work announces samples ([`SampleSource::expect`]), two threads make them
//! in order: the first reads the cache and decodes frames, the second runs the policy's frozen half. On a GPU, the caller's thread runs the
//! frozen half.
//!
//! The threads wait when as many samples are ready as the work takes at once, with at most three more. Samples, errors and their order stay
//! the same.

use std::borrow::Cow;
use std::cell::RefCell;
use std::panic::resume_unwind;
use std::sync::mpsc::{sync_channel, Receiver, SyncSender};
use std::thread::{self, Scope, ScopedJoinHandle};

use crate::error::Result;
use crate::frames::batch::SampleSource;
use crate::frames::making::{Begun, Coming, MakesSamples};

/// Does `work` with the samples of `source`, and makes expected ones in the background.
pub fn ahead<S, R>(source: &dyn SampleSource<S>, work: impl FnOnce(&dyn SampleSource<S>) -> R) -> R
where
    S: Clone + Send + 'static,
{
    let Some(maker) = source.makes() else {
        return work(source);
    };
    // At the end of `work`, the threads finish their current frames.
    thread::scope(|scope| {
        work(&Ahead {
            source,
            maker,
            scope,
            expected: RefCell::new(None),
        })
    })
}

struct Ahead<'scope, 'env, S> {
    source: &'env dyn SampleSource<S>,
    maker: &'env dyn MakesSamples<S>,
    scope: &'scope Scope<'scope, 'env>,
    expected: RefCell<Option<Expected<'scope, S>>>,
}

type Next<S> = (usize, Result<Begun<S>>);

struct Expected<'scope, S> {
    ready: Receiver<Next<S>>,
    /// Taken, not yet asked for.
    next: Option<Next<S>>,
    threads: Vec<ScopedJoinHandle<'scope, ()>>,
}

impl<S> Expected<'_, S> {
    /// The next sample; `None` unless its number is `index`.
    fn take(&mut self, index: usize) -> Option<Result<Begun<S>>> {
        if self.next.is_none() {
            self.next = self.ready.recv().ok();
        }
        let (_, begun) = self.next.take_if(|(number, _)| *number == index)?;
        Some(begun)
    }

    fn end(self) {
        drop(self.ready);
        for thread in self.threads {
            if let Err(panic) = thread.join() {
                resume_unwind(panic);
            }
        }
    }
}

impl<'scope, S: Clone + Send + 'static> Ahead<'scope, '_, S> {
    fn start(&self, coming: Coming, at_once: usize) -> Expected<'scope, S> {
        let (maker, scope) = (self.maker, self.scope);
        let begin = move |sender: SyncSender<Next<S>>| {
            for index in coming {
                // Fails when no more samples are taken.
                if sender.send((index, maker.begin(index))).is_err() {
                    return;
                }
            }
        };
        let (sender, ready) = sync_channel(at_once);
        let threads = if maker.finished_by_asker() {
            vec![scope.spawn(move || begin(sender))]
        } else {
            let (half, begun) = sync_channel::<Next<S>>(1);
            let finish = move || {
                for (index, part) in begun {
                    let whole = part.and_then(|part| maker.finish(index, part));
                    if sender.send((index, whole.map(Begun::Whole))).is_err() {
                        return;
                    }
                }
            };
            vec![scope.spawn(move || begin(half)), scope.spawn(finish)]
        };
        Expected {
            ready,
            next: None,
            threads,
        }
    }

    fn end(&self) {
        if let Some(expected) = self.expected.take() {
            expected.end();
        }
    }
}

impl<S: Clone + Send + 'static> SampleSource<S> for Ahead<'_, '_, S> {
    fn len(&self) -> usize {
        self.source.len()
    }

    fn sample(&self, index: usize) -> Result<Cow<'_, S>> {
        let expected = &mut *self.expected.borrow_mut();
        match expected.as_mut().and_then(|next| next.take(index)) {
            Some(begun) => Ok(Cow::Owned(self.maker.finish(index, begun?)?)),
            None => self.source.sample(index),
        }
    }

    fn rest(&self) {
        self.end();
        self.source.rest();
    }

    fn expect(&self, coming: Coming, at_once: usize) {
        self.end();
        *self.expected.borrow_mut() = Some(self.start(coming, at_once));
    }
}
