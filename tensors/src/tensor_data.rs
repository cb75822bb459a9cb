//! Tensors as plain numbers, with checks.

use std::collections::BTreeMap;

use crate::error::{Result, TensorError};

/// One tensor, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct TensorData {
    /// Dimensions.
    pub shape: Vec<usize>,
    /// Its elements: the product of the dimensions.
    pub data: Vec<f32>,
}

/// Tensors by name, in name order.
pub type TensorSet = BTreeMap<String, TensorData>;

/// Shapes by name, in name order.
pub type TensorShapes = BTreeMap<String, Vec<usize>>;

impl TensorData {
    /// Checks the shape and the number of elements.
    ///
    /// # Errors
    /// [`TensorError::Shape`].
    pub fn check_shape(&self, name: &str, shape: &[usize]) -> Result<()> {
        if self.shape != shape || self.data.len() != shape.iter().product::<usize>() {
            return Err(TensorError::Shape {
                name: name.into(),
                expected: shape.to_vec(),
                found: self.shape.clone(),
            });
        }
        Ok(())
    }

    /// The tensor, if every number is finite.
    ///
    /// # Errors
    /// [`TensorError::NotFinite`].
    pub fn finite(self, name: &str) -> Result<Self> {
        check_finite(name, &self.data)?;
        Ok(self)
    }
}

/// Checks that a set has exactly the tensors and shapes of `layout`, and only finite numbers.
///
/// # Errors
/// [`TensorError`] names the wrong tensor.
pub fn check_layout(tensors: &TensorSet, layout: &TensorShapes) -> Result<()> {
    if let Some(name) = tensors.keys().find(|n| !layout.contains_key(*n)) {
        return Err(TensorError::Unexpected(name.clone()));
    }
    for (name, shape) in layout {
        let tensor = tensors
            .get(name)
            .ok_or_else(|| TensorError::Missing(name.clone()))?;
        tensor.check_shape(name, shape)?;
        check_finite(name, &tensor.data)?;
    }
    Ok(())
}

/// Refuses NaN and infinities.
///
/// # Errors
/// [`TensorError::NotFinite`], with the place of the first.
pub fn check_finite(name: &str, numbers: &[f32]) -> Result<()> {
    match numbers.iter().position(|x| !x.is_finite()) {
        Some(index) => Err(TensorError::NotFinite {
            name: name.into(),
            index,
            value: numbers[index].to_string(),
        }),
        None => Ok(()),
    }
}
