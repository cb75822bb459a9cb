//! The verifier's half of mode `checked`: it projects the weight matrices of a file with the coefficients that a proof used,
//! tensor by tensor, and compares the result with what was in the guest.
//!
//! One tensor is in memory at a time: a full-size expert (98 M weights, 197 MB) takes some 10 MB. Two threads project the two
//! sets of weights side by side. A browser has no threads: there the sets are projected one after the other.

use std::thread;
use zk0_circuits::freivalds::coefficients::Coefficients;
use zk0_circuits::freivalds::hints::coefficients;
use zk0_circuits::freivalds::projection;
use zk0_circuits::model::eval::Evaluator;
use zk0_circuits::model::parameters::Parameters;
use zk0_circuits::{GuestWeights, WeightCheck};
use zk0_protocol::Refusal;
use zk0_tensors::ReadAt;
use zk0_weights::{Format, WeightsError, WeightsFile};

/// Checks that the products a proof took on trust are those with the weights in the files `base` and `update`.
pub fn check_projections<R: ReadAt + Send>(
    format: &Format,
    claimed: &WeightCheck,
    base: R,
    update: R,
) -> Result<(), Refusal> {
    let evaluator = Evaluator::new(format.spec())
        .map_err(|error| Refusal::MalformedUpdate(error.to_string()))?;
    let coefficients = coefficients(&evaluator, &claimed.seed);
    let project = |file: R| project(format, &evaluator, &coefficients, file);
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
    format: &Format,
    evaluator: &Evaluator<'_>,
    coefficients: &Coefficients,
    file: impl ReadAt,
) -> Result<GuestWeights, String> {
    let file = format.open(file).map_err(|error| error.to_string())?;
    let parameters = parameters(format, &file)?.digest();
    let projections = projection::project(evaluator, coefficients, |index| {
        let tensor = file.tensor(index)?;
        Ok::<_, WeightsError>((tensor.values, tensor.bits))
    });
    let projections = projections.map_err(|error| error.to_string())?;
    Ok(GuestWeights {
        parameters,
        projections: projection::digest(&projections),
    })
}

/// The gains and biases of the weights in a file.
fn parameters<R: ReadAt>(format: &Format, file: &WeightsFile<'_, R>) -> Result<Parameters, String> {
    let (mut scales, mut values) = (Vec::new(), Vec::new());
    for (index, tensor) in format.tensors().iter().enumerate() {
        if tensor.shape.len() == 1 {
            let tensor = file.tensor(index).map_err(|error| error.to_string())?;
            scales.push(tensor.bits);
            values.extend(tensor.values);
        }
    }
    let all = scales.iter().chain(&values);
    let mut bytes: Vec<u8> = all.flat_map(|value| value.to_le_bytes()).collect();
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    Parameters::from_bytes(format.spec(), &bytes).map_err(|error| error.to_string())
}
