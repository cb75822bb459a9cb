//! From decoded video to RGB, bit for bit as in LeRobot, which uses FFmpeg's swscale.

mod full;
mod matrix;
mod repeated;
mod rgb;
mod rounded;
mod yuv;

pub use matrix::{ColorMatrix, Colors};
pub use rgb::rgb_from_yuv;
pub use yuv::{Sampling, Yuv, YuvFormat};
