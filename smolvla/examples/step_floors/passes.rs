//! Measures the operations that pass over numbers once: pictures, norms, activations and sums.

use zk0_lerobot::config::{PolicyConfig, CHANNELS};
use zk0_smolvla::frames::image::vision_input;
use zk0_smolvla::policy::model::kernels::gelu::gelu_tanh;
use zk0_smolvla::policy::model::kernels::norm::{layer_norm, rms_norm};
use zk0_smolvla::policy::model::kernels::swiglu::swiglu;

use crate::report::{run, tensor, variable, Least, Report};
use crate::Failure;

/// The height and width of a webcam's pictures.
const RECORDED: (usize, usize) = (480, 640);

pub fn pictures(report: &mut Report, c: &PolicyConfig, batch: usize) -> Result<(), Failure> {
    let size = c.vision.image_size;
    let (recorded, resized) = (CHANNELS * RECORDED.0 * RECORDED.1, CHANNELS * size * size);
    let picture = vec![100u8; recorded];
    // A picture has one byte for each number.
    let least = Least::moving(recorded / 4 + resized);
    report.kernel("pictures: resized", c.cameras * batch, least, || {
        std::hint::black_box(vision_input(&picture, RECORDED, size));
    });
    let (x, p) = (tensor(&[batch, CHANNELS, size, size])?, c.vision.patch_size);
    let least = Least::moving(2 * batch * resized);
    report.kernel("vision: patches", c.cameras, least, || {
        let side = size / p;
        let patches = x
            .narrow(2, 0, side * p)
            .and_then(|x| x.narrow(3, 0, side * p))
            .and_then(|x| x.reshape((batch, CHANNELS, side, p, side, p)))
            .and_then(|x| x.permute((0, 2, 4, 1, 3, 5)))
            .and_then(|x| x.reshape((batch, side * side, CHANNELS * p * p)));
        run(patches);
    });
    Ok(())
}

pub fn vision(report: &mut Report, c: &PolicyConfig, batch: usize) -> Result<(), Failure> {
    let (patches, width) = (c.patches(), c.vision.width);
    let x = tensor(&[batch, patches, c.vision.mlp_width])?;
    let least = Least::moving(2 * batch * patches * c.vision.mlp_width);
    let layers = c.cameras * c.vision.layers;
    report.kernel("vision: GELU", layers, least, || run(gelu_tanh(x.clone())));
    let (x, gain) = (tensor(&[batch, patches, width])?, tensor(&[width])?);
    let norms = 2 * layers + c.cameras;
    let least = Least::moving(2 * batch * patches * width);
    report.kernel("vision: LayerNorm", norms, least, || {
        run(layer_norm(&x, &gain, &gain, 1e-6))
    });
    Ok(())
}

pub fn language_and_expert(
    report: &mut Report,
    c: &PolicyConfig,
    batch: usize,
) -> Result<(), Failure> {
    let (layers, eps) = (c.text.layers, c.rms_norm_eps);
    let (tokens, width, mlp_width) = (c.max_prefix_tokens(), c.text.width, c.text.mlp_width);
    let numbers = |width: usize, tensors: usize| Least::moving(tensors * batch * tokens * width);
    let (gate, up) = (
        tensor(&[batch, tokens, mlp_width])?,
        tensor(&[batch, tokens, mlp_width])?,
    );
    report.kernel("text: SwiGLU", layers - 1, numbers(mlp_width, 3), || {
        run(swiglu(&gate, &up))
    });
    let (x, gain) = (tensor(&[batch, tokens, width])?, tensor(&[width])?);
    let norms = 2 * layers - 1;
    report.kernel("text: RMSNorm", norms, numbers(width, 2), || {
        run(rms_norm(&x, &gain, eps))
    });
    let residuals = 2 * (layers - 1);
    report.kernel("text: sums", residuals, numbers(width, 3), || run(&x + &x));

    let (text, expert) = (&c.text, &c.expert);
    for (part, tokens, width, mlp_width, layers) in [
        ("state token", 1, text.width, text.mlp_width, layers - 1),
        (
            "expert",
            c.chunk_size,
            expert.width,
            expert.mlp_width,
            layers,
        ),
    ] {
        let numbers =
            |width: usize, tensors: usize| Least::moving(tensors * batch * tokens * width);
        let (gate, up) = (
            variable(&[batch, tokens, mlp_width])?,
            variable(&[batch, tokens, mlp_width])?,
        );
        let least = (numbers(mlp_width, 3), numbers(mlp_width, 5));
        report.trained(&format!("{part}: SwiGLU"), layers, least, || {
            Ok(swiglu(&gate, &up)?)
        })?;
        let (x, y) = (
            variable(&[batch, tokens, width])?,
            variable(&[batch, tokens, width])?,
        );
        // The gains on the way of the state token are frozen.
        let gain = match part {
            "expert" => variable(&[width])?,
            _ => tensor(&[width])?,
        };
        let (name, calls) = (format!("{part}: RMSNorm"), 2 * layers + 1);
        let least = (numbers(width, 2), numbers(width, 3));
        report.trained(&name, calls, least, || Ok(rms_norm(&x, &gain, eps)?))?;
        let least = (numbers(width, 3), numbers(width, 2));
        report.trained(&format!("{part}: sums"), 2 * layers, least, || {
            Ok((&x + &y)?)
        })?;
    }
    Ok(())
}
