//! Nodes that send back what they got.

use crate::Failure;
use std::convert::Infallible;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use zk0_simulate::rounds::{round, Federation};

/// Holds the memory of updates that are in the sum already. New memory costs a page fault for every 4 KiB, which is more than the sum costs.
#[derive(Default)]
struct Echo(Mutex<Vec<Vec<f64>>>);

impl Echo {
    fn spare(&self) -> MutexGuard<'_, Vec<Vec<f64>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Federation for Echo {
    type Global = Arc<Vec<f64>>;
    /// As in Flower, an update is memory of its own.
    type Update = Vec<f64>;
    type Collected = (Vec<f64>, usize);
    type Error = Infallible;

    fn train(&self, _: u64, _: usize, global: &Self::Global) -> Result<Vec<f64>, Infallible> {
        let mut update = self.spare().pop().unwrap_or_default();
        update.clear();
        update.extend_from_slice(global);
        Ok(update)
    }

    fn begin(&self, global: &Self::Global) -> Self::Collected {
        (vec![0.0; global.len()], 0)
    }

    fn add(
        &self,
        (sum, count): &mut Self::Collected,
        _: usize,
        update: Vec<f64>,
    ) -> Result<(), Infallible> {
        sum.iter_mut()
            .zip(&update)
            .for_each(|(sum, value)| *sum += value);
        *count += 1;
        self.spare().push(update);
        Ok(())
    }

    fn combine(
        &self,
        _: Self::Global,
        (mut sum, count): Self::Collected,
    ) -> Result<Self::Global, Infallible> {
        sum.iter_mut().for_each(|value| *value /= count as f64);
        Ok(Arc::new(sum))
    }
}

pub fn run(bytes: usize, nodes: usize, rounds: u64, threads: usize) -> Result<(), Failure> {
    let (all, echo) = ((0..nodes).collect::<Vec<_>>(), Echo::default());
    let mut global = Arc::new(vec![1.5; bytes.div_ceil(8)]);
    for number in 0..rounds {
        global = round(&echo, number, &all, global, threads)?;
    }
    match global.iter().all(|value| *value == 1.5) {
        true => Ok(()),
        false => Err("the mean of equal updates is another value".into()),
    }
}
