//! The verifier's half of mode `checked`: it projects the weight matrices of a file with the coefficients that a proof used,
//! tensor by tensor, and compares the result with what was in the guest.
//!
//! One tensor is in memory at a time: a full-size expert (98 M weights, 393 MB) takes some 20 MB. Two threads project the two
//! sets of weights side by side. A browser has no threads: there the sets are projected one after the other.

use crate::weights::check_header;
use safetensors::tensor::Metadata;
use safetensors::Dtype;
use std::collections::HashMap;
use std::io::{Read, Seek, SeekFrom};
use std::thread;
use zk0_circuits::freivalds::hints::coefficients;
use zk0_circuits::freivalds::projection;
use zk0_circuits::model::eval::Evaluator;
use zk0_circuits::model::parameters::Parameters;
use zk0_circuits::model::quantise::QuantiseError;
use zk0_circuits::model::weights::Quantiser;
use zk0_circuits::{EvalSpec, GuestWeights, WeightCheck};
use zk0_protocol::quote::short;
use zk0_protocol::Refusal;

/// Checks that the products a proof took on trust are those with the weights in the files `base` and `update`
/// (safetensors, as [`crate::ExpertTensors::read`] accepts them).
pub fn check_projections<R: Read + Seek + Send>(
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
    file: impl Read + Seek,
) -> Result<GuestWeights, String> {
    let quantiser = Quantiser::new(evaluator.spec);
    let mut file = TensorFile::open(file)?;
    let small: HashMap<&str, Vec<f32>> = quantiser
        .tensors()
        .iter()
        .filter(|tensor| tensor.shape.len() == 1)
        .map(|tensor| {
            Ok((
                tensor.name.as_str(),
                file.read(&tensor.name, &tensor.shape)?,
            ))
        })
        .collect::<Result<_, String>>()?;
    let get = |name: &str| small.get(name).map(Vec::as_slice);
    let parameters = Parameters::quantise(&quantiser, evaluator.spec, get);
    let parameters = parameters.map_err(|error| error.to_string())?.digest();
    let projections = projection::project(evaluator, coefficients, |index| {
        let tensor = &quantiser.tensors()[index];
        let source = file.read(&tensor.name, &tensor.shape)?;
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

/// A safetensors file whose tensors are read one by one.
struct TensorFile<R> {
    file: R,
    /// Where the tensors' bytes begin.
    start: u64,
    metadata: Metadata,
}

impl<R: Read + Seek> TensorFile<R> {
    fn open(mut file: R) -> Result<Self, String> {
        let failed = |error: std::io::Error| error.to_string();
        let size = file.seek(SeekFrom::End(0)).map_err(failed)?;
        file.rewind().map_err(failed)?;
        let mut length = [0; 8];
        file.read_exact(&mut length).map_err(failed)?;
        let header = check_header(size, &length).map_err(|error| error.to_string())?;
        let mut bytes = Vec::new();
        let mut header = (&mut file).take(header);
        header.read_to_end(&mut bytes).map_err(failed)?;
        let metadata = serde_json::from_slice(&bytes)
            .map_err(|error| format!("bad safetensors header: {}", short(&error.to_string())))?;
        Ok(Self {
            file,
            start: 8 + bytes.len() as u64,
            metadata,
        })
    }

    /// The values of a float32 tensor, row-major.
    fn read(&mut self, name: &str, shape: &[usize]) -> Result<Vec<f32>, String> {
        let info = self
            .metadata
            .info(name)
            .ok_or_else(|| format!("tensor '{name}' is missing"))?;
        let (from, to) = info.data_offsets;
        let len: usize = shape.iter().product();
        let size = to.checked_sub(from);
        if info.dtype != Dtype::F32 || info.shape != shape || size != Some(4 * len) {
            return Err(format!("tensor '{name}' is not F32 of shape {shape:?}"));
        }
        let mut values = vec![0f32; len];
        let failed = |error: std::io::Error| error.to_string();
        let place = SeekFrom::Start(self.start.saturating_add(from as u64));
        self.file.seek(place).map_err(failed)?;
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut values);
        self.file.read_exact(bytes).map_err(failed)?;
        Ok(values)
    }
}
