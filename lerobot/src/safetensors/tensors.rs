//! Tensors as plain numbers, and the checks that all of them pass.

use std::collections::BTreeMap;

use crate::error::{Result, StoredPolicyError};
use crate::layout::Layout;

/// One tensor, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct TensorData {
    /// Dimensions.
    pub shape: Vec<usize>,
    /// As many elements as the dimensions' product.
    pub data: Vec<f32>,
}

/// Tensors by LeRobot's names, in name order.
pub type TensorSet = BTreeMap<String, TensorData>;

/// Checks that a set has exactly the tensors of `layout`, with its shapes, and that every number is finite.
///
/// # Errors
/// Says which tensor is missing, unexpected, of another shape, or not finite.
pub fn check_layout(tensors: &TensorSet, layout: &Layout) -> Result<()> {
    if let Some(name) = tensors.keys().find(|n| !layout.contains_key(*n)) {
        return Err(StoredPolicyError::UnexpectedTensor(name.clone()));
    }
    for (name, shape) in layout {
        let tensor = tensors
            .get(name)
            .ok_or_else(|| StoredPolicyError::MissingTensor(name.clone()))?;
        check_shape(name, tensor, shape)?;
        check_finite(name, &tensor.data)?;
    }
    Ok(())
}

/// Checks that a tensor has the shape, and as many numbers as it asks for.
///
/// # Errors
/// [`StoredPolicyError::Shape`].
pub(crate) fn check_shape(name: &str, tensor: &TensorData, shape: &[usize]) -> Result<()> {
    if tensor.shape != shape || tensor.data.len() != shape.iter().product::<usize>() {
        return Err(StoredPolicyError::Shape {
            name: name.into(),
            expected: shape.to_vec(),
            found: tensor.shape.clone(),
        });
    }
    Ok(())
}

/// Refuses NaN and infinities.
///
/// # Errors
/// [`StoredPolicyError::NotFinite`], with the place of the first.
pub fn check_finite(name: &str, numbers: &[f32]) -> Result<()> {
    match numbers.iter().position(|x| !x.is_finite()) {
        Some(index) => Err(StoredPolicyError::NotFinite {
            name: name.into(),
            index,
            value: numbers[index],
        }),
        None => Ok(()),
    }
}
