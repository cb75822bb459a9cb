//! Where the evaluation does not read.

use zk0_circuits::model::layout::TensorSpec;
use zk0_circuits::model::linear::linears;
use zk0_circuits::EvalSpec;

/// The unread end of a tensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TensorStretch {
    /// The tensor's number.
    pub tensor: usize,
    /// The first unread value, in row-major order.
    pub from: usize,
}

/// The rest of each tensor after the rows of the linear layers. Norm gains are read whole.
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
