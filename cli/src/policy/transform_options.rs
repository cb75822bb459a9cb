//! The options for transforms of training pictures.

use anyhow::{bail, Context, Result};
use serde::Serialize;
use serde_json::Value;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use zk0_smolvla::frames::image_transforms::{ImageTransformsConfig, Variants};

const DEFAULT_VARIANTS: usize = 4;

const MAX_CONFIG: u64 = 1 << 20;

/// Which transforms training frames get.
#[derive(Clone, Debug, clap::Args)]
pub struct TransformOptions {
    /// Transform the pictures of training frames at random, as LeRobot does with dataset.image_transforms.enable. What is evaluated or
    /// committed to is not transformed.
    #[arg(long)]
    image_transforms: bool,
    /// Read the transforms from this JSON file: LeRobot's train_config.json, or its part dataset.image_transforms [default: LeRobot's
    /// defaults]
    #[arg(long, value_name = "FILE")]
    image_transforms_config: Option<PathBuf>,
    /// Apply at most this many transforms to a picture [default: 3]
    #[arg(long, value_name = "COUNT")]
    max_num_transforms: Option<usize>,
    /// Apply the transforms of a picture in a random order. Without this, they have the order of the configuration.
    #[arg(long)]
    random_order: bool,
    /// Make this many transformed variants of each training frame. Each is computed once, and takes its own place in the prefix cache
    /// [default: 4]
    #[arg(long, value_name = "COUNT")]
    image_variants: Option<usize>,
}

/// A run report's entry about transforms.
#[derive(Clone, Debug, Serialize)]
pub struct Transforms {
    #[serde(flatten)]
    config: ImageTransformsConfig,
    variants: usize,
}

impl TransformOptions {
    /// The transforms; `None` if pictures stay as recorded.
    ///
    /// # Errors
    /// The configuration cannot be read or used, or options have no use without transforms.
    pub fn transforms(&self) -> Result<Option<Transforms>> {
        let mut config = match &self.image_transforms_config {
            Some(path) => read(path)
                .with_context(|| format!("reading the image transforms of {}", path.display()))?,
            None => ImageTransformsConfig::default(),
        };
        config.enable |= self.image_transforms;
        config.random_order |= self.random_order;
        config.max_num_transforms = self.max_num_transforms.unwrap_or(config.max_num_transforms);
        config.sampler()?;
        if !config.enable {
            let given = [
                (
                    self.image_transforms_config.is_some(),
                    "image-transforms-config",
                ),
                (self.max_num_transforms.is_some(), "max-num-transforms"),
                (self.random_order, "random-order"),
                (self.image_variants.is_some(), "image-variants"),
            ];
            if let Some((_, name)) = given.iter().find(|(given, _)| *given) {
                bail!("--{name} is given, and nothing is transformed: add --image-transforms, or leave --{name} out");
            }
            return Ok(None);
        }
        Ok(Some(Transforms {
            config,
            variants: self.image_variants.unwrap_or(DEFAULT_VARIANTS),
        }))
    }

    /// Makes variants of training frames.
    ///
    /// # Errors
    /// As [`Self::transforms`].
    pub fn variants(&self, seed: u64) -> Result<Option<Variants>> {
        match self.transforms()? {
            Some(Transforms { config, variants }) => {
                Ok(Variants::new(&config, variants, seed).context("--image-variants")?)
            }
            None => Ok(None),
        }
    }
}

/// Also reads a configuration of LeRobot's training that contains them.
fn read(path: &Path) -> Result<ImageTransformsConfig> {
    let mut text = String::new();
    File::open(path)?
        .take(MAX_CONFIG + 1)
        .read_to_string(&mut text)?;
    if text.len() as u64 > MAX_CONFIG {
        bail!("the file is larger than {MAX_CONFIG} bytes");
    }
    let value: Value = serde_json::from_str(&text)?;
    if value.get("dataset").is_none() {
        return Ok(serde_json::from_str(&text)?);
    }
    /// Read from the text, because the order counts.
    #[derive(serde::Deserialize)]
    struct Training {
        dataset: Dataset,
    }
    #[derive(serde::Deserialize)]
    struct Dataset {
        image_transforms: ImageTransformsConfig,
    }
    let training: Training = serde_json::from_str(&text)?;
    Ok(training.dataset.image_transforms)
}
