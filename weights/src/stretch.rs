//! Where the evaluation does not read: it follows from the rows that the linear layers use.

use zk0_circuits::model::layout::TensorSpec;
use zk0_circuits::model::linear::linears;
use zk0_circuits::EvalSpec;

/// The end of a tensor, which the evaluation does not read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TensorStretch {
    /// The tensor's number.
    pub tensor: usize,
    /// The first value that is not read, in row-major order.
    pub from: usize,
}

/// Where the weights lie that the evaluation of a valid specification does not read: what is left of each tensor after the rows that
/// the linear layers use. It reads the whole of every norm gain.
pub(crate) fn stretches(spec: &EvalSpec, tensors: &[TensorSpec]) -> Vec<TensorStretch> {
    let linears = linears(spec);
    let outputs = linears
        .iter()
        .flat_map(|linear| linear.outputs.iter().map(move |output| (linear, output)));
    let read = outputs.flat_map(|(linear, output)| {
        let matrix = Some((output.matrix, output.rows * linear.columns));
        let bias = output.bias.map(|bias| (bias, output.rows));
        matrix.into_iter().chain(bias)
    });
    read.filter(|(tensor, read)| *read < tensors[*tensor].len())
        .map(|(tensor, from)| TensorStretch { tensor, from })
        .collect()
}
