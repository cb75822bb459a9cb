//! Between float32 weights in training and int16 weights that travel.

use crate::error::ParticipantError;
use zk0_circuits::QuantisedWeights;
use zk0_smolvla::measure::fixed_point::{dequantise_weights, quantise_weights};
use zk0_smolvla::{ExpertWeights, PolicyConfig};
use zk0_weights::Format;

/// A round's base weights.
pub struct Base {
    /// As they travel.
    pub quantised: QuantisedWeights,
    /// The same numbers in float32.
    pub weights: ExpertWeights,
}

impl Base {
    /// Reads a base's file.
    ///
    /// # Errors
    /// The file does not hold weights of this format.
    pub fn read(
        format: &Format,
        config: &PolicyConfig,
        file: &[u8],
    ) -> Result<Self, ParticipantError> {
        let quantised = format.read(file)?;
        Ok(Self {
            weights: dequantise_weights(config, format.spec(), &quantised)?,
            quantised,
        })
    }

    /// Quantises weights that were trained from this base; they are rounded only here. Weights that the evaluation does not read get the
    /// base's numbers: weight decay could change them, and the verifier refuses that.
    ///
    /// # Errors
    /// A weight is too large for every scale.
    pub fn update(
        &self,
        format: &Format,
        config: &PolicyConfig,
        trained: ExpertWeights,
    ) -> Result<QuantisedWeights, ParticipantError> {
        let mut tensors = trained.into_tensors();
        for stretch in format.unread() {
            let name = &format.tensors()[stretch.tensor].name;
            let base = self.weights.tensors().get(name);
            if let (Some(tensor), Some(base)) = (tensors.get_mut(name), base) {
                tensor.data[stretch.from..].copy_from_slice(&base.data[stretch.from..]);
            }
        }
        let restored = ExpertWeights::from_tensors(config, tensors)?;
        Ok(quantise_weights(format.spec(), &restored)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use zk0_circuits::EvalSpec;
    use zk0_smolvla::policy::init::init_policy;
    use zk0_smolvla::Profile;
    use zk0_weights::Unread;

    /// Holds also if unread weights have moved and the scale is coarser.
    #[test]
    fn an_update_keeps_the_base_where_nothing_is_evaluated() {
        let config = Profile::Micro.config();
        let spec = EvalSpec::new(zk0_smolvla::measure::fixed_point::dims(&config).unwrap());
        let format = Format::new(&spec).unwrap();
        let start = quantise_weights(&spec, &init_policy(&config, 5).unwrap().expert).unwrap();
        let base = Base::read(&format, &config, &format.write(&start)).unwrap();
        assert_eq!(base.quantised, start);

        let file = format.write(&start);
        let unread = Unread::of(&format, &format.open(&file[..]).unwrap()).unwrap();
        for growth in [0.01, 1.0, 1.9, 3.7, 30.0] {
            let mut trained = base.weights.clone().into_tensors();
            for (name, tensor) in &mut trained {
                if name.contains("action_out_proj") {
                    tensor.data.iter_mut().for_each(|value| *value *= growth);
                }
            }
            let trained = ExpertWeights::from_tensors(&config, trained).unwrap();
            let as_it_is = quantise_weights(&spec, &trained).unwrap();
            assert_eq!(unread.check(&format, &as_it_is).is_ok(), growth == 1.0);
            let update = base.update(&format, &config, trained).unwrap();
            assert_eq!(unread.check(&format, &update), Ok(()), "{growth}");
        }
    }
}
