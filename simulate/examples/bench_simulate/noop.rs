//! Nodes that send back what they got.

use crate::Failure;
use std::convert::Infallible;
use std::sync::Arc;
use zk0_simulate::rounds::{round, Federation};

struct Echo;

impl Federation for Echo {
    type Global = Arc<Vec<f64>>;
    /// As in Flower, an update is memory of its own.
    type Update = Vec<f64>;
    type Collected = (Vec<f64>, usize);
    type Error = Infallible;

    fn train(&self, _: u64, _: usize, global: &Self::Global) -> Result<Vec<f64>, Infallible> {
        Ok(global.to_vec())
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
    let all: Vec<_> = (0..nodes).collect();
    let mut global = Arc::new(vec![1.5; bytes.div_ceil(8)]);
    for number in 0..rounds {
        global = round(&Echo, number, &all, global, threads)?;
    }
    match global.iter().all(|value| *value == 1.5) {
        true => Ok(()),
        false => Err("the mean of equal updates is another value".into()),
    }
}
