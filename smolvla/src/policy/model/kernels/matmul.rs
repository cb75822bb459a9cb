//! Products by candle's operations, on any device.

use candle_core::{DType, Result, Tensor};

/// `a·b` for a (…, M, K) and b (…, K, N) of one type, each contiguous or transposed from that, as cuBLAS needs. Shorter numbers are summed
/// in `f32` and then rounded.
pub(super) fn matmul(a: &Tensor, b: &Tensor) -> Result<Tensor> {
    for operand in [a, b] {
        if !operand.is_contiguous() && !operand.t()?.is_contiguous() {
            candle_core::bail!("a product of strided matrices {:?}", operand.layout());
        }
    }
    // candle has no bf16 product on the CPU. A bf16 is an f32 with zero last bits, so the f32 product is the same.
    if a.dtype() == DType::BF16 && a.device().is_cpu() {
        let wide = a.to_dtype(DType::F32)?.matmul(&b.to_dtype(DType::F32)?)?;
        return wide.to_dtype(DType::BF16);
    }
    a.matmul(b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::{Device, Var};
    use half::bf16;

    fn wave(shape: (usize, usize), step: f32) -> Tensor {
        let values = (0..shape.0 * shape.1).map(|i| (i as f32 * step).sin());
        let values: Vec<f32> = values.collect();
        Tensor::from_vec(values, shape, &Device::Cpu).unwrap()
    }

    #[test]
    fn bf16_is_rounded_where_a_gpu_rounds() {
        let (m, n, k) = (3, 5, 40);
        let (a, b) = (wave((m, k), 0.3), wave((n, k), 0.7));
        let short = |x: &Tensor| x.to_dtype(DType::BF16).unwrap();
        let product = matmul(&short(&a), &short(&b).t().unwrap()).unwrap();
        assert_eq!(product.dtype(), DType::BF16);
        let product: Vec<Vec<bf16>> = product.to_vec2().unwrap();
        let rows = |x: &Tensor| -> Vec<Vec<bf16>> { short(x).to_vec2().unwrap() };
        let (a, b) = (rows(&a), rows(&b));
        for (a, found) in a.iter().zip(product) {
            for (b, found) in b.iter().zip(found) {
                let exact: f64 = a.iter().zip(b).map(|(a, b)| a.to_f64() * b.to_f64()).sum();
                // Half a unit in the last of eight bits, plus f32's rounding.
                let allowed = exact.abs() / 256.0 + 1e-5;
                assert!((found.to_f64() - exact).abs() <= allowed, "{found} {exact}");
                assert_eq!(found, bf16::from_f32(found.to_f32()));
            }
        }
    }

    #[test]
    fn gradients_go_through_the_rounding() {
        let (a, b) = (wave((3, 4), 0.3), wave((4, 5), 0.7));
        let gradient = |a: &Var, product: Tensor| -> Vec<Vec<f32>> {
            let loss = product.to_dtype(DType::F32).unwrap().sqr().unwrap();
            let gradients = loss.sum_all().unwrap().backward().unwrap();
            gradients.get(a).unwrap().to_vec2().unwrap()
        };
        let x = Var::from_tensor(&a).unwrap();
        let short = x.to_dtype(DType::BF16).unwrap();
        let rounded = matmul(&short, &b.to_dtype(DType::BF16).unwrap()).unwrap();
        let plain = matmul(&x, &b).unwrap();
        let (rounded, plain) = (gradient(&x, rounded), gradient(&x, plain));
        for (rounded, plain) in rounded.concat().iter().zip(plain.concat()) {
            assert!((rounded - plain).abs() < 0.05, "{rounded} {plain}");
        }
    }

    #[test]
    fn matrices_that_a_gpu_does_not_take_are_refused_here_too() {
        let a = wave((4, 6), 0.3);
        let strided = wave((6, 10), 0.7).narrow(1, 2, 5).unwrap();
        let error = matmul(&a, &strided).unwrap_err().to_string();
        assert!(error.contains("strided"), "{error}");
        matmul(&a, &strided.contiguous().unwrap()).unwrap();
        matmul(&a.t().unwrap(), &a).unwrap();
    }
}
