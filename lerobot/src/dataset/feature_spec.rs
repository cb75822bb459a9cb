//! The kind of a recording as bytes to commit to. Recordings with the same digest can be evaluated with the same model inputs.

use sha2::{Digest, Sha256};

use crate::dataset::metadata::info::{ACTION, STATE};
use crate::dataset::{Dataset, VectorFeature};

/// Domain-separation tag of the digest.
pub const FEATURE_SPEC_TAG: &str = "zk0:feature-spec:v1";

impl Dataset {
    /// The canonical description for action chunks of `chunk` frames.
    ///
    /// Numbers are u64 little-endian, strings are length and UTF-8 bytes, lists are count and items. In order: the tag; fps; chunk; state
    /// and action, each as name, dtype (`float32`), shape, names; cameras, each as name, dtype (`uint8`), shape (`3, height, width`).
    pub fn feature_spec(&self, chunk: usize) -> Vec<u8> {
        let mut spec = Spec(Vec::new());
        spec.text(FEATURE_SPEC_TAG);
        spec.number(self.fps() as usize);
        spec.number(chunk);
        spec.vector(STATE, &self.info().state);
        spec.vector(ACTION, &self.info().action);
        spec.number(self.cameras().len());
        for camera in self.cameras() {
            spec.tensor(&camera.name, "uint8", &[3, camera.height, camera.width]);
        }
        spec.0
    }

    /// SHA-256 of [`Dataset::feature_spec`].
    pub fn feature_spec_digest(&self, chunk: usize) -> [u8; 32] {
        Sha256::digest(self.feature_spec(chunk)).into()
    }
}

struct Spec(Vec<u8>);

impl Spec {
    fn number(&mut self, n: usize) {
        self.0.extend((n as u64).to_le_bytes());
    }

    fn text(&mut self, s: &str) {
        self.number(s.len());
        self.0.extend(s.as_bytes());
    }

    fn tensor(&mut self, name: &str, dtype: &str, shape: &[usize]) {
        self.text(name);
        self.text(dtype);
        self.number(shape.len());
        shape.iter().for_each(|&n| self.number(n));
    }

    fn vector(&mut self, name: &str, feature: &VectorFeature) {
        self.tensor(name, "float32", &[feature.dim]);
        self.number(feature.names.len());
        feature.names.iter().for_each(|n| self.text(n));
    }
}
