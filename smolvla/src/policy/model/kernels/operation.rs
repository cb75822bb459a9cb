//! A kernel's operation and gradients.

use std::ops::Deref;

use candle_core::{
    bail, CpuStorage, CustomOp1, CustomOp2, CustomOp3, Error, Layout, Result, Shape, Tensor,
};

/// Of a contiguous `f32` CPU tensor, in order.
#[derive(Clone, Copy)]
pub(super) struct CpuValues<'a> {
    pub all: &'a [f32],
    pub shape: &'a Shape,
}

impl<'a> CpuValues<'a> {
    fn of(storage: &'a CpuStorage, layout: &'a Layout) -> Result<Self> {
        let values = storage.as_slice::<f32>()?;
        match layout.contiguous_offsets() {
            Some((from, to)) => Ok(Self {
                all: &values[from..to],
                shape: layout.shape(),
            }),
            None => bail!("a kernel needs a contiguous tensor, not {layout:?}"),
        }
    }
}

impl Deref for CpuValues<'_> {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        self.all
    }
}

pub(super) type KernelOutput = Result<(Vec<f32>, Shape)>;

pub(super) type Gradients<const N: usize> = Result<[Option<Tensor>; N]>;

pub(super) trait Kernel<const N: usize> {
    const NAME: &'static str;

    fn forward(&self, arguments: [CpuValues; N]) -> KernelOutput;

    /// From arguments, result and its gradient to their gradients.
    fn backward(&self, _: [&Tensor; N], _: &Tensor, _: &Tensor) -> Gradients<N> {
        Err(Error::BackwardNotSupported { op: Self::NAME })
    }
}

pub(super) struct CpuOperation<K>(pub K);

type Stored = Result<(CpuStorage, Shape)>;

fn run<K: Kernel<N>, const N: usize>(kernel: &K, arguments: [CpuValues; N]) -> Stored {
    let (values, shape) = kernel.forward(arguments)?;
    Ok((CpuStorage::F32(values), shape))
}

impl<K: Kernel<1>> CustomOp1 for CpuOperation<K> {
    fn name(&self) -> &'static str {
        K::NAME
    }

    fn cpu_fwd(&self, s: &CpuStorage, l: &Layout) -> Stored {
        run(&self.0, [CpuValues::of(s, l)?])
    }

    fn bwd(&self, a: &Tensor, out: &Tensor, grad: &Tensor) -> Result<Option<Tensor>> {
        let [of_a] = self.0.backward([a], out, grad)?;
        Ok(of_a)
    }
}

impl<K: Kernel<2>> CustomOp2 for CpuOperation<K> {
    fn name(&self) -> &'static str {
        K::NAME
    }

    fn cpu_fwd(&self, s1: &CpuStorage, l1: &Layout, s2: &CpuStorage, l2: &Layout) -> Stored {
        run(&self.0, [CpuValues::of(s1, l1)?, CpuValues::of(s2, l2)?])
    }

    fn bwd(
        &self,
        a: &Tensor,
        b: &Tensor,
        out: &Tensor,
        grad: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        Ok(self.0.backward([a, b], out, grad)?.into())
    }
}

impl<K: Kernel<3>> CustomOp3 for CpuOperation<K> {
    fn name(&self) -> &'static str {
        K::NAME
    }

    fn cpu_fwd(
        &self,
        s1: &CpuStorage,
        l1: &Layout,
        s2: &CpuStorage,
        l2: &Layout,
        s3: &CpuStorage,
        l3: &Layout,
    ) -> Stored {
        let (a, b) = (CpuValues::of(s1, l1)?, CpuValues::of(s2, l2)?);
        run(&self.0, [a, b, CpuValues::of(s3, l3)?])
    }

    fn bwd(
        &self,
        a: &Tensor,
        b: &Tensor,
        c: &Tensor,
        out: &Tensor,
        grad: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        Ok(self.0.backward([a, b, c], out, grad)?.into())
    }
}
