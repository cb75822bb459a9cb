//! The verifier's half of mode `checked`: it projects the weight matrices of a file with the coefficients that a proof used,
//! tensor by tensor, and compares the result with what was in the guest.
//!
//! One tensor is in memory at a time: a full-size expert (98 M weights, 393 MB) takes some 20 MB. Two threads project the two
//! sets of weights side by side. A browser has no threads: there the sets are projected one after the other.

use crate::weights::{named, MAX_HEADER_BYTES};
use std::collections::HashMap;
use std::thread;
use zk0_circuits::freivalds::hints::coefficients;
use zk0_circuits::freivalds::projection;
use zk0_circuits::model::eval::Evaluator;
use zk0_circuits::model::parameters::Parameters;
use zk0_circuits::model::quantise::QuantiseError;
use zk0_circuits::model::weights::Quantiser;
use zk0_circuits::{EvalSpec, GuestWeights, WeightCheck};
use zk0_protocol::Refusal;
use zk0_tensors::{ReadAt, TensorFile};

/// Checks that the products a proof took on trust are those with the weights in the files `base` and `update`
/// (safetensors, as [`crate::ExpertTensors::read`] accepts them).
pub fn check_projections<R: ReadAt + Send>(
    spec: &EvalSpec,
    claimed: &WeightCheck,
    base: R,
    update: R,
) -> Result<(), Refusal> {
    let evaluator =
        Evaluator::new(spec).map_err(|error| Refusal::MalformedUpdate(error.to_string()))?;
    let coefficients = coefficients(&evaluator, &claimed.seed);
    let project = |file: R| project(&evaluator, &coefficients, file);
    let (base, update) = match cfg!(target_family = "wasm") {
        true => (project(base), project(update)),
        false => thread::scope(|threads| {
            let base = threads.spawn(|| project(base));
            let update = project(update);
            let panicked = |_| Err("the thread that projects the base weights panicked".into());
            (base.join().unwrap_or_else(panicked), update)
        }),
    };
    let base = base.map_err(Refusal::MalformedUpdate)?;
    let update = update.map_err(Refusal::MalformedUpdate)?;
    for (which, claimed, actual) in [
        ("base", claimed.base, base),
        ("update", claimed.update, update),
    ] {
        if claimed != actual {
            return Err(Refusal::OtherProducts {
                which: which.into(),
            });
        }
    }
    Ok(())
}

/// What the guest reads of the weights in `file`.
fn project(
    evaluator: &Evaluator<'_>,
    coefficients: &zk0_circuits::freivalds::coefficients::Coefficients,
    file: impl ReadAt,
) -> Result<GuestWeights, String> {
    let quantiser = Quantiser::new(evaluator.spec);
    let file = TensorFile::open(file, MAX_HEADER_BYTES).map_err(named)?;
    let read = |name: &str, shape: &[usize]| {
        let tensor = file.read_f32(name, shape).map_err(named)?;
        Ok::<_, String>(tensor.data)
    };
    let small: HashMap<&str, Vec<f32>> = quantiser
        .tensors()
        .iter()
        .filter(|tensor| tensor.shape.len() == 1)
        .map(|tensor| Ok((tensor.name.as_str(), read(&tensor.name, &tensor.shape)?)))
        .collect::<Result<_, String>>()?;
    let get = |name: &str| small.get(name).map(Vec::as_slice);
    let parameters = Parameters::quantise(&quantiser, evaluator.spec, get);
    let parameters = parameters.map_err(|error| error.to_string())?.digest();
    let projections = projection::project(evaluator, coefficients, |index| {
        let tensor = &quantiser.tensors()[index];
        let source = read(&tensor.name, &tensor.shape)?;
        let mut values = vec![0i16; source.len()];
        let bits = quantiser
            .quantise(index, &source, &mut values)
            .map_err(|error: QuantiseError| error.to_string())?;
        Ok::<_, String>((values, bits))
    })?;
    Ok(GuestWeights {
        parameters,
        projections: projection::digest(&projections),
    })
}
