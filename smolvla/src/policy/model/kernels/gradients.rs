//! Gradients of a loss; those of linear maps' weights are stored directly. candle first adds each gradient to zeros: two more passes over
//! memory for large weights.

use std::cell::RefCell;

use candle_core::backprop::GradStore;
use candle_core::{Result, Tensor};

thread_local! {
    /// While [`backward`] runs in this thread.
    static COLLECTED: RefCell<Option<Vec<(Tensor, Tensor)>>> = const { RefCell::new(None) };
}

/// As `loss.backward()`.
pub fn backward(loss: &Tensor) -> Result<GradStore> {
    COLLECTED.set(Some(Vec::new()));
    let store = loss.backward();
    let collected = COLLECTED.take().unwrap_or_default();
    let mut store = store?;
    for (weight, gradient) in collected {
        let gradient = match store.get(&weight) {
            None => gradient,
            Some(before) => (before + gradient)?,
        };
        store.insert(&weight, gradient);
    }
    Ok(store)
}

/// Stores a variable's gradient while [`backward`] runs, and returns any other.
pub(super) fn collect(weight: &Tensor, gradient: Tensor) -> Option<Tensor> {
    COLLECTED.with_borrow_mut(|collected| match collected {
        Some(collected) if weight.is_variable() => {
            collected.push((weight.clone(), gradient.detach()));
            None
        }
        _ => Some(gradient),
    })
}

#[cfg(test)]
mod tests {
    use super::super::linear::LinearLayer;
    use super::*;
    use candle_core::{Device, Var};

    #[test]
    fn they_are_candles_for_weights_used_once_twice_or_on_the_way() {
        let variable = |shape: (usize, usize), step: f32| {
            let count = shape.0 * shape.1;
            let values: Vec<f32> = (0..count).map(|i| (i as f32 * step).sin()).collect();
            Var::from_tensor(&Tensor::from_vec(values, shape, &Device::Cpu).unwrap()).unwrap()
        };
        let (x, once, twice) = (
            variable((4, 3), 0.3),
            variable((3, 3), 0.7),
            variable((3, 3), 1.1),
        );
        let apply = |w: &Tensor, x: &Tensor| LinearLayer::new(w.clone(), None).forward(x).unwrap();
        // Its gradient must go on.
        let made = twice.sin().unwrap();
        let out = apply(&twice, &apply(&made, &apply(&twice, &apply(&once, &x))));
        // This weight has another use.
        let loss = (out.sqr().unwrap().sum_all().unwrap() + once.sqr().unwrap().sum_all()).unwrap();
        let (ours, theirs) = (backward(&loss).unwrap(), loss.backward().unwrap());
        for variable in [&x, &once, &twice] {
            let list = |t: Option<&Tensor>| t.unwrap().flatten_all().unwrap().to_vec1::<f32>();
            let (ours, theirs) = (list(ours.get(variable)), list(theirs.get(variable)));
            for (ours, theirs) in ours.unwrap().iter().zip(&theirs.unwrap()) {
                assert!((ours - theirs).abs() <= 1e-6 * theirs.abs().max(1.0));
            }
        }
    }
}
