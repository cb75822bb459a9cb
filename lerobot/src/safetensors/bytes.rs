//! A safetensors file whose bytes are in memory.

use std::collections::HashMap;

use safetensors::tensor::{Dtype, SafeTensors};

use super::number_types::decode;
use super::tensors::{check_finite, TensorData, TensorSet};
use crate::error::{Result, StoredPolicyError};
use crate::layout::Layout;

/// Reads a file that holds exactly the tensors of `layout`, in F32; those named in `ignored` may be there too.
///
/// # Errors
/// Says which tensor is missing, unexpected, of another shape or type, or not finite.
pub fn read_exactly(bytes: &[u8], layout: &Layout, ignored: &[&str]) -> Result<TensorSet> {
    let file = open(bytes)?;
    let foreign = file.names().into_iter().map(|n| n.to_string());
    if let Some(name) = foreign
        .filter(|n| !layout.contains_key(n) && !ignored.contains(&n.as_str()))
        .min()
    {
        return Err(StoredPolicyError::UnexpectedTensor(name));
    }
    let read = |(name, shape): (&String, &Vec<usize>)| {
        let tensor = read_from(&file, name, shape)?;
        Ok((name.clone(), tensor))
    };
    layout.iter().map(read).collect()
}

/// Gives a reader of single tensors of a file, each by its name and the shape that it must have. They must be F32 and finite.
///
/// # Errors
/// [`StoredPolicyError::Safetensors`] when the bytes are not a complete file. The reader says which tensor is missing, of another
/// shape or type, or not finite.
pub fn read_f32(bytes: &[u8]) -> Result<impl Fn(&str, &[usize]) -> Result<TensorData> + '_> {
    let file = open(bytes)?;
    Ok(move |name: &str, shape: &[usize]| read_from(&file, name, shape))
}

/// The metadata of a file, by key. Reads no tensor.
///
/// # Errors
/// [`StoredPolicyError::Safetensors`] when the header is not whole.
pub fn metadata_of(bytes: &[u8]) -> Result<HashMap<String, String>> {
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(broken)?;
    Ok(header.metadata().clone().unwrap_or_default())
}

fn open(bytes: &[u8]) -> Result<SafeTensors<'_>> {
    SafeTensors::deserialize(bytes).map_err(broken)
}

fn broken(error: safetensors::SafeTensorError) -> StoredPolicyError {
    StoredPolicyError::Safetensors(error.to_string())
}

fn read_from(file: &SafeTensors, name: &str, shape: &[usize]) -> Result<TensorData> {
    let view = file
        .tensor(name)
        .map_err(|_| StoredPolicyError::MissingTensor(name.into()))?;
    if view.dtype() != Dtype::F32 {
        return Err(StoredPolicyError::Dtype {
            name: name.into(),
            found: format!("{:?}", view.dtype()),
            accepted: "F32",
        });
    }
    if view.shape() != shape {
        return Err(StoredPolicyError::Shape {
            name: name.into(),
            expected: shape.to_vec(),
            found: view.shape().to_vec(),
        });
    }
    // The library has checked that the bytes are as many as type and shape ask for.
    let mut data = Vec::with_capacity(view.data().len() / 4);
    decode(Dtype::F32, view.data(), &mut data);
    check_finite(name, &data)?;
    Ok(TensorData {
        shape: shape.to_vec(),
        data,
    })
}
