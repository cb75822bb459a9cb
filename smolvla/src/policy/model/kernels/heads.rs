//! Attention's two products for query heads that share key and value heads, without copying these. A head's matrix has strided rows with
//! tokens first, (B, tokens, heads, dim); with heads first, it is contiguous.

use candle_core::{Result, Shape, Tensor};

use crate::policy::model::kernels::dispatch::{in_chunks, serve};
use crate::policy::model::kernels::matmul::matmul;
use crate::policy::model::kernels::matrix::{product, Into, StridedMatrix, Threads};
use crate::policy::model::kernels::operation::{
    CpuOperation, CpuValues, Gradients, Kernel, KernelOutput,
};

/// `q·kᵀ` for queries (B, Q, heads, dim) and keys (B, K, kv_heads, dim): (B, heads, Q, K). Query head `h` meets key head
/// `h / (heads / kv_heads)`.
pub fn queries_by_keys(q: &Tensor, k: &Tensor) -> Result<Tensor> {
    if serve(q) {
        return q
            .contiguous()?
            .apply_op2(&k.contiguous()?, CpuOperation(QueriesByKeys));
    }
    let (batch, queries, heads, dim) = q.dims4()?;
    let (_, keys, kv_heads, _) = k.dims4()?;
    // Stacks queries of one key head.
    let q = q.transpose(1, 2)?.contiguous()?;
    let q = q.reshape((batch * kv_heads, heads / kv_heads * queries, dim))?;
    let scores = matmul(&q, &heads_first(k)?.t()?)?;
    scores.reshape((batch, heads, queries, keys))
}

/// `p·v` for weights (B, heads, Q, K) and values (B, K, kv_heads, dim): (B, heads, Q, dim), in the values' type.
pub fn weights_by_values(p: &Tensor, v: &Tensor) -> Result<Tensor> {
    if serve(p) && serve(v) {
        return p
            .contiguous()?
            .apply_op2(&v.contiguous()?, CpuOperation(WeightsByValues));
    }
    let (batch, heads, queries, keys) = p.dims4()?;
    let (kv_heads, dim) = (v.dim(2)?, v.dim(3)?);
    let p = p.to_dtype(v.dtype())?;
    let p = p.reshape((batch * kv_heads, heads / kv_heads * queries, keys))?;
    matmul(&p, &heads_first(v)?)?.reshape((batch, heads, queries, dim))
}

/// (B, K, kv_heads, dim) as (B * kv_heads, K, dim).
fn heads_first(x: &Tensor) -> Result<Tensor> {
    let (batch, tokens, heads, dim) = x.dims4()?;
    let x = x.transpose(1, 2)?.contiguous()?;
    x.reshape((batch * heads, tokens, dim))
}

struct QueriesByKeys;

impl Kernel<2> for QueriesByKeys {
    const NAME: &'static str = "queries-by-keys";

    fn forward(&self, [q, k]: [CpuValues; 2]) -> KernelOutput {
        let q = HeadMatrices::tokens_first(q)?;
        let k = HeadMatrices::tokens_first(k)?;
        let group = group(
            q.heads,
            k.heads,
            q.batch == k.batch && q.columns == k.columns,
        )?;
        let mut out = vec![0.0; q.batch * q.heads * q.rows * k.rows];
        in_chunks(&mut out, q.rows * k.rows, 2 * q.columns, |at, out| {
            let keys = k.matrix(at / group).transposed();
            multiply(q.matrix(at), keys, out, k.rows, Into::Replace);
        });
        let shape = Shape::from((q.batch, q.heads, q.rows, k.rows));
        Ok((out, shape))
    }

    fn backward(&self, [q, k]: [&Tensor; 2], _: &Tensor, grad: &Tensor) -> Gradients<2> {
        let grad = grad.contiguous()?;
        let of_q = q.track_op().then(|| {
            let of_q = grad.apply_op2_no_bwd(k, &CpuOperation(WeightsByValues))?;
            of_q.transpose(1, 2)
        });
        let of_k = k.track_op().then(|| summed_over_queries(&grad, q, k));
        Ok([of_q.transpose()?, of_k.transpose()?])
    }
}

struct WeightsByValues;

impl Kernel<2> for WeightsByValues {
    const NAME: &'static str = "weights-by-values";

    fn forward(&self, [p, v]: [CpuValues; 2]) -> KernelOutput {
        let p = HeadMatrices::heads_first(p)?;
        let v = HeadMatrices::tokens_first(v)?;
        let group = group(p.heads, v.heads, p.batch == v.batch && p.columns == v.rows)?;
        let mut out = vec![0.0; p.batch * p.heads * p.rows * v.columns];
        in_chunks(&mut out, p.rows * v.columns, 2 * v.rows, |at, out| {
            let values = v.matrix(at / group);
            multiply(p.matrix(at), values, out, v.columns, Into::Replace);
        });
        let shape = Shape::from((p.batch, p.heads, p.rows, v.columns));
        Ok((out, shape))
    }

    fn backward(&self, [p, v]: [&Tensor; 2], _: &Tensor, grad: &Tensor) -> Gradients<2> {
        let grad = grad.transpose(1, 2)?.contiguous()?;
        let of_p = p
            .track_op()
            .then(|| grad.apply_op2_no_bwd(v, &CpuOperation(QueriesByKeys)));
        let of_v = v.track_op().then(|| summed_over_queries(p, &grad, v));
        Ok([of_p.transpose()?, of_v.transpose()?])
    }
}

/// The gradient of `like` (B, K, kv_heads, dim): per head, the sum of `pᵀ·x` over its sharers, for p (B, heads, Q, K) and x (B, Q, heads,
/// dim).
fn summed_over_queries(p: &Tensor, x: &Tensor, like: &Tensor) -> Result<Tensor> {
    let kv_heads = like.dim(2)?;
    p.apply_op2_no_bwd(x, &CpuOperation(SummedOverQueries { kv_heads }))?
        .transpose(1, 2)
}

struct SummedOverQueries {
    kv_heads: usize,
}

impl Kernel<2> for SummedOverQueries {
    const NAME: &'static str = "summed-over-queries";

    fn forward(&self, [p, x]: [CpuValues; 2]) -> KernelOutput {
        let p = HeadMatrices::heads_first(p)?;
        let x = HeadMatrices::tokens_first(x)?;
        let fits = p.batch == x.batch && p.heads == x.heads && p.rows == x.rows;
        let group = group(p.heads, self.kv_heads, fits)?;
        let mut out = vec![0.0; p.batch * self.kv_heads * p.columns * x.columns];
        let operations = 2 * group * p.rows;
        in_chunks(&mut out, p.columns * x.columns, operations, |at, out| {
            for head in at * group..(at + 1) * group {
                let weights = p.matrix(head).transposed();
                multiply(weights, x.matrix(head), out, x.columns, Into::Add);
            }
        });
        let shape = Shape::from((p.batch, self.kv_heads, p.columns, x.columns));
        Ok((out, shape))
    }
}

/// A matrix (rows, columns) per head and sample.
struct HeadMatrices<'a> {
    values: &'a [f32],
    batch: usize,
    heads: usize,
    rows: usize,
    columns: usize,
    tokens_first: bool,
}

impl<'a> HeadMatrices<'a> {
    /// (B, rows, heads, columns).
    fn tokens_first(x: CpuValues<'a>) -> Result<Self> {
        let (batch, rows, heads, columns) = x.shape.dims4()?;
        Ok(Self {
            values: x.all,
            batch,
            heads,
            rows,
            columns,
            tokens_first: true,
        })
    }

    /// (B, heads, rows, columns).
    fn heads_first(x: CpuValues<'a>) -> Result<Self> {
        let (batch, heads, rows, columns) = x.shape.dims4()?;
        Ok(Self {
            values: x.all,
            batch,
            heads,
            rows,
            columns,
            tokens_first: false,
        })
    }

    /// Matrix number `at`, a sample's heads first.
    fn matrix(&self, at: usize) -> StridedMatrix<'a> {
        let (sample, head) = (at / self.heads, at % self.heads);
        let sample = &self.values[sample * self.rows * self.heads * self.columns..];
        let (start, stride) = if self.tokens_first {
            (head * self.columns, self.heads * self.columns)
        } else {
            (head * self.rows * self.columns, self.columns)
        };
        StridedMatrix::strided(&sample[start..], self.rows, self.columns, stride)
    }
}

fn group(heads: usize, kv_heads: usize, fits: bool) -> Result<usize> {
    if !fits || kv_heads == 0 || !heads.is_multiple_of(kv_heads) {
        candle_core::bail!("{heads} heads of queries and {kv_heads} of keys do not fit together");
    }
    Ok(heads / kv_heads)
}

/// In one thread: heads run in parallel.
fn multiply(a: StridedMatrix, b: StridedMatrix, out: &mut [f32], columns: usize, into: Into) {
    product(a, b, 1.0, out, columns, into, Threads::One);
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::{DType, Device, Var};

    fn variable(shape: [usize; 4], step: f32) -> Var {
        let count = shape.iter().product::<usize>();
        let values = (0..count).map(|i| (i as f32 * step).sin()).collect();
        let tensor = Tensor::from_vec(values, shape.as_slice(), &Device::Cpu).unwrap();
        Var::from_tensor(&tensor).unwrap()
    }

    fn close(a: &Tensor, b: &Tensor) {
        let difference = (a - b.to_dtype(DType::F32).unwrap())
            .unwrap()
            .abs()
            .unwrap();
        let difference = difference.flatten_all().unwrap().max(0).unwrap();
        let largest: f32 = difference.to_scalar().unwrap();
        assert!(largest < 1e-5, "{largest}");
    }

    fn double(x: &Var) -> Var {
        Var::from_tensor(&x.to_dtype(DType::F64).unwrap()).unwrap()
    }

    #[test]
    fn values_and_gradients_are_candles() {
        let (batch, queries, keys, heads, kv_heads, dim) = (2, 3, 5, 6, 2, 4);
        let (q, k) = (
            variable([batch, queries, heads, dim], 0.3),
            variable([batch, keys, kv_heads, dim], 0.7),
        );
        let (p, v) = (
            variable([batch, heads, queries, keys], 0.9),
            variable([batch, keys, kv_heads, dim], 1.1),
        );
        type Product = fn(&Tensor, &Tensor) -> Result<Tensor>;
        let cases = [
            (queries_by_keys as Product, q, k),
            (weights_by_values as Product, p, v),
        ];
        for (product, a, b) in cases {
            let (wide_a, wide_b) = (double(&a), double(&b));
            let ours = product(&a, &b).unwrap();
            let theirs = product(&wide_a, &wide_b).unwrap();
            close(&ours, &theirs);
            let gradients = |x: Tensor| x.sin().unwrap().sum_all().unwrap().backward().unwrap();
            let (ours, theirs) = (gradients(ours), gradients(theirs));
            for (ours_of, theirs_of) in [(&a, &wide_a), (&b, &wide_b)] {
                close(ours.get(ours_of).unwrap(), theirs.get(theirs_of).unwrap());
            }
        }
    }

    #[test]
    fn shapes_that_do_not_fit_are_errors() {
        let q = variable([1, 3, 4, 2], 0.3);
        for keys in [[1, 5, 3, 2], [2, 5, 2, 2], [1, 5, 2, 3]] {
            assert!(queries_by_keys(&q, &variable(keys, 0.7)).is_err());
        }
        let p = variable([1, 4, 3, 5], 0.3);
        assert!(weights_by_values(&p, &variable([1, 6, 2, 2], 0.7)).is_err());
    }
}
