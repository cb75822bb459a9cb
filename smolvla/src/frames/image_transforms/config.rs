//! The configuration, as LeRobot's `dataset.image_transforms`.

use std::fmt;

use serde::de::{Deserializer, MapAccess, Visitor};
use serde::ser::{SerializeMap, Serializer};
use serde::{Deserialize, Serialize};
use serde_json::{json, Map, Value};

use crate::error::{PolicyError, Result};
use crate::frames::image_transforms::drawing::{Jitter, Sampler, UniformRange};

/// LeRobot's `ImageTransformsConfig`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ImageTransformsConfig {
    /// Whether training frames are transformed.
    pub enable: bool,
    /// The most transforms a picture gets.
    pub max_num_transforms: usize,
    /// In random order, not that of [`Self::tfs`].
    pub random_order: bool,
    /// The transforms to choose from.
    pub tfs: Tfs,
}

/// Transforms by name, in their order.
#[derive(Clone, Debug, PartialEq)]
pub struct Tfs(pub Vec<(String, ImageTransformConfig)>);

/// LeRobot's `ImageTransformConfig`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ImageTransformConfig {
    /// Its frequency relative to the others; 0 for never.
    pub weight: f64,
    /// `Identity`, `ColorJitter`, `SharpnessJitter` or `RandomAffine`.
    #[serde(rename = "type")]
    pub kind: String,
    /// Its parameters' bounds.
    pub kwargs: Map<String, Value>,
}

impl Default for ImageTransformConfig {
    fn default() -> Self {
        Self {
            weight: 1.0,
            kind: "Identity".into(),
            kwargs: Map::new(),
        }
    }
}

impl Default for ImageTransformsConfig {
    fn default() -> Self {
        let jitter = |name: &str| match name {
            "sharpness" => "SharpnessJitter",
            "affine" => "RandomAffine",
            _ => "ColorJitter",
        };
        let tfs = [
            ("brightness", json!({"brightness": [0.8, 1.2]})),
            ("contrast", json!({"contrast": [0.8, 1.2]})),
            ("saturation", json!({"saturation": [0.5, 1.5]})),
            ("hue", json!({"hue": [-0.05, 0.05]})),
            ("sharpness", json!({"sharpness": [0.5, 1.5]})),
            (
                "affine",
                json!({"degrees": [-5.0, 5.0], "translate": [0.05, 0.05]}),
            ),
        ];
        let tfs = tfs.map(|(name, kwargs)| {
            let config = ImageTransformConfig {
                kind: jitter(name).into(),
                kwargs: kwargs.as_object().cloned().unwrap_or_default(),
                ..ImageTransformConfig::default()
            };
            (name.to_owned(), config)
        });
        Self {
            enable: false,
            max_num_transforms: 3,
            random_order: false,
            tfs: Tfs(tfs.into()),
        }
    }
}

impl ImageTransformsConfig {
    /// Draws transforms; `None` for no transforms.
    ///
    /// # Errors
    /// [`PolicyError::Options`] names the transform and the value.
    pub fn sampler(&self) -> Result<Option<Sampler>> {
        if self.max_num_transforms == 0 {
            return Err(PolicyError::Options(
                "image transforms: `max_num_transforms` is 0; it must be 1 or more".into(),
            ));
        }
        let mut choices = Vec::new();
        for (name, tf) in &self.tfs.0 {
            let wrong =
                |why: String| PolicyError::Options(format!("image transforms: `{name}`: {why}"));
            if !tf.weight.is_finite() {
                return Err(wrong(format!("`weight` is {}", tf.weight)));
            }
            let jitter = jitter(tf).map_err(wrong)?;
            // As in LeRobot.
            if tf.weight > 0.0 {
                choices.push((tf.weight, jitter));
            }
        }
        let count = choices.len().min(self.max_num_transforms);
        Ok((self.enable && count > 0).then_some(Sampler {
            choices,
            count,
            random_order: self.random_order,
        }))
    }
}

fn jitter(tf: &ImageTransformConfig) -> std::result::Result<Jitter, String> {
    let mut kwargs = Kwargs(tf.kwargs.clone());
    let jitter = match &*tf.kind {
        "Identity" => Jitter::Identity,
        "ColorJitter" => Jitter::Color {
            brightness: kwargs.factor("brightness")?,
            contrast: kwargs.factor("contrast")?,
            saturation: kwargs.factor("saturation")?,
            hue: kwargs.around("hue", 0.0, [-0.5, 0.5])?,
        },
        "SharpnessJitter" => {
            let sharpness = kwargs.factor("sharpness")?;
            Jitter::Sharpness(sharpness.ok_or("`sharpness` is missing")?)
        }
        "RandomAffine" => {
            let any = [f64::NEG_INFINITY, f64::INFINITY];
            let shear = match kwargs.0.remove("shear") {
                None | Some(Value::Null) => [None, None],
                Some(Value::Array(four)) if four.len() == 4 => {
                    let mut pairs = Kwargs(Map::new());
                    for (name, pair) in ["x", "y"].iter().zip(four.chunks(2)) {
                        pairs.0.insert((*name).into(), pair.to_vec().into());
                    }
                    [pairs.around("x", 0.0, any)?, pairs.around("y", 0.0, any)?]
                }
                Some(shear) => {
                    kwargs.0.insert("shear".into(), shear);
                    [kwargs.around("shear", 0.0, any)?, None]
                }
            };
            let degrees = kwargs.around("degrees", 0.0, any)?;
            Jitter::Affine {
                degrees: degrees.ok_or("`degrees` is missing")?,
                translate: kwargs.shares("translate")?,
                scale: kwargs.around("scale", 1.0, [f64::MIN_POSITIVE, f64::INFINITY])?,
                shear,
            }
        }
        other => {
            return Err(format!(
                "no type is called `{other}`; there are Identity, ColorJitter, SharpnessJitter and RandomAffine"
            ))
        }
    };
    match kwargs.0.keys().next() {
        None => Ok(jitter),
        Some(name) => Err(format!("{} has no parameter `{name}` here", tf.kind)),
    }
}

struct Kwargs(Map<String, Value>);

impl Kwargs {
    /// 1 changes nothing.
    fn factor(&mut self, name: &str) -> std::result::Result<Option<UniformRange>, String> {
        self.around(name, 1.0, [0.0, f64::INFINITY])
    }

    /// Two bounds, or their distance from `centre`.
    fn around(
        &mut self,
        name: &str,
        centre: f64,
        [least, most]: [f64; 2],
    ) -> std::result::Result<Option<UniformRange>, String> {
        let range = match self.0.remove(name) {
            None | Some(Value::Null) => return Ok(None),
            Some(Value::Number(number)) => {
                let distance = number.as_f64().unwrap_or(f64::NAN);
                let low = centre - distance;
                // As in torchvision.
                let low = if least == 0.0 { low.max(0.0) } else { low };
                [low, centre + distance]
            }
            Some(given) => pair(&given).ok_or(format!(
                "`{name}` is {given}; it must be a number or two numbers"
            ))?,
        };
        let [low, high] = range;
        if !(least <= low && low <= high && high <= most && low.is_finite() && high.is_finite()) {
            return Err(format!(
                "`{name}` is from {low} to {high}; it must rise within {least} to {most}"
            ));
        }
        Ok(Some(UniformRange { low, high }))
    }

    fn shares(&mut self, name: &str) -> std::result::Result<Option<[f64; 2]>, String> {
        let given = match self.0.remove(name) {
            None | Some(Value::Null) => return Ok(None),
            Some(given) => given,
        };
        match pair(&given) {
            Some(shares) if shares.iter().all(|share| (0.0..=1.0).contains(share)) => {
                Ok(Some(shares))
            }
            _ => Err(format!(
                "`{name}` is {given}; it must be two numbers from 0 to 1"
            )),
        }
    }
}

fn pair(value: &Value) -> Option<[f64; 2]> {
    match value.as_array()?.as_slice() {
        [low, high] => Some([low.as_f64()?, high.as_f64()?]),
        _ => None,
    }
}

// A map does not keep the order.
impl Serialize for Tfs {
    fn serialize<S: Serializer>(&self, to: S) -> std::result::Result<S::Ok, S::Error> {
        let mut map = to.serialize_map(Some(self.0.len()))?;
        for (name, tf) in &self.0 {
            map.serialize_entry(name, tf)?;
        }
        map.end()
    }
}

impl<'de> Deserialize<'de> for Tfs {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        struct InOrder;

        impl<'de> Visitor<'de> for InOrder {
            type Value = Tfs;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("transforms by name")
            }

            fn visit_map<M: MapAccess<'de>>(
                self,
                mut map: M,
            ) -> std::result::Result<Tfs, M::Error> {
                let mut tfs = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    tfs.push(entry);
                }
                Ok(Tfs(tfs))
            }
        }

        from.deserialize_map(InOrder)
    }
}
