//! The part of the mp4 container (ISO/IEC 14496-12, AV1 in ISOBMFF, and 14496-15 for H.264 and HEVC) that LeRobot's videos use: where each
//! frame's bytes are and when it is shown.
//!
//! Files may be damaged: every length is checked against its container, so no input panics or allocates more than a small multiple of the
//! file.

mod boxes;
pub(crate) mod nal_config;
pub(crate) mod sample;
mod tables;
pub(crate) mod track;
pub(crate) mod turn;
