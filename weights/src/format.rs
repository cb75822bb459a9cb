//! The files of one network's weights.
//!
//! A file is a safetensors file of I16 tensors: first [`SCALES`], then the [`expert_tensors`], with LeRobot's names and shapes, in that
//! order. The header has no metadata and is the same in all files of a network. The evaluation's buffer follows
//! ([`QuantisedWeights::as_bytes`], without the padding).

use crate::error::{short, WeightFileError};
use crate::scale::{self, ScaledTensor};
use crate::stretch::{stretches, TensorStretch};
use std::borrow::Cow;
use zk0_circuits::model::layout::{expert_tensors, Layout, TensorSpec};
use zk0_circuits::model::linear::bit_limits;
use zk0_circuits::model::spec::SpecError;
use zk0_circuits::vm::values::Values;
use zk0_circuits::{EvalSpec, QuantisedWeights};
use zk0_tensors::{Dtype, ReadAt, TensorFile, TensorHeader};

/// The tensor of the others' fraction bits.
pub const SCALES: &str = "fraction_bits";

/// Largest header in bytes. The published size has 19 KB.
const MAX_HEADER_BYTES: u64 = 1 << 20;

/// The format of one network's files.
#[derive(Clone, Debug)]
pub struct Format {
    spec: EvalSpec,
    tensors: Vec<TensorSpec>,
    layout: Layout,
    limits: Vec<(i16, i16)>,
    header: Vec<u8>,
    unread: Vec<TensorStretch>,
}

impl Format {
    /// The format for `spec`.
    ///
    /// # Errors
    /// The specification is not valid.
    pub fn new(spec: &EvalSpec) -> Result<Self, SpecError> {
        spec.validate()?;
        let tensors = expert_tensors(&spec.dims);
        let scales = (SCALES.to_owned(), Dtype::I16, vec![tensors.len()]);
        let rest = tensors
            .iter()
            .map(|tensor| (tensor.name.clone(), Dtype::I16, tensor.shape.clone()));
        let header = TensorHeader::new(None, std::iter::once(scales).chain(rest));
        Ok(Self {
            layout: Layout::new(&spec.dims),
            limits: bit_limits(spec, tensors.len()),
            // Too few tensors for the limit.
            header: header.to_bytes().unwrap_or_default(),
            unread: stretches(spec, &tensors),
            spec: spec.clone(),
            tensors,
        })
    }

    /// The specification.
    pub fn spec(&self) -> &EvalSpec {
        &self.spec
    }

    /// The tensors, in the file's order.
    pub fn tensors(&self) -> &[TensorSpec] {
        &self.tensors
    }

    /// Least and most fraction bits of each tensor.
    pub fn limits(&self) -> &[(i16, i16)] {
        &self.limits
    }

    /// The weights that are not evaluated.
    pub fn unread(&self) -> &[TensorStretch] {
        &self.unread
    }

    /// Size of a file in bytes.
    pub fn file_bytes(&self) -> u64 {
        (8 + self.header.len() + 2 * self.layout.len) as u64
    }

    /// The first byte and the number of values of a tensor.
    pub fn place(&self, index: usize) -> (u64, usize) {
        let place = self.layout.tensors[index];
        ((8 + self.header.len() + 2 * place.start) as u64, place.len)
    }

    /// The row-major values and fraction bits of a tensor. `weights` are of this specification.
    pub fn tensor<'w>(&self, weights: &'w QuantisedWeights, index: usize) -> (&'w [i16], i16) {
        weights.tensor(&self.layout, index)
    }

    /// Whether `weights` have as many values.
    pub fn fits(&self, weights: &QuantisedWeights) -> bool {
        weights.as_bytes().len() == Values::byte_len(self.layout.len)
    }

    /// Opens a file and checks its size, header and scales, without the values.
    ///
    /// # Errors
    /// The fault and the tensor.
    pub fn open<R: ReadAt>(&self, source: R) -> Result<WeightsFile<'_, R>, WeightFileError> {
        let file = TensorFile::open(source, MAX_HEADER_BYTES)?;
        if file.header() != self.header {
            return Err(self.difference(&file));
        }
        let scales = file.read_i16(SCALES, &[self.tensors.len()])?;
        for ((tensor, limits), bits) in self.tensors.iter().zip(&self.limits).zip(&scales) {
            scale::check_limits(&tensor.name, *bits, *limits)?;
        }
        Ok(WeightsFile {
            format: self,
            file,
            scales,
        })
    }

    /// Reads all weights of a file.
    ///
    /// # Errors
    /// As [`Self::open`]; or a scale is wrong.
    pub fn read(&self, file: &[u8]) -> Result<QuantisedWeights, WeightFileError> {
        self.open(file)?;
        // The file's length agrees with the header.
        let mut buffer = Cow::Borrowed(&file[8 + self.header.len()..]);
        if buffer.len() != Values::byte_len(self.layout.len) {
            buffer.to_mut().resize(Values::byte_len(self.layout.len), 0);
        }
        let weights = QuantisedWeights::from_bytes(&self.spec, &buffer)?;
        for index in 0..self.tensors.len() {
            let (values, bits) = self.tensor(&weights, index);
            self.check_scale(index, values, bits)?;
        }
        Ok(weights)
    }

    /// The file of `weights`, which are of this specification. Equal weights give equal bytes.
    pub fn write(&self, weights: &QuantisedWeights) -> Vec<u8> {
        let numbers = &weights.as_bytes()[..2 * self.layout.len];
        let length = (self.header.len() as u64).to_le_bytes();
        [&length[..], &self.header, numbers].concat()
    }

    /// Makes a file. `fill` gets the tensors' places in order, writes little-endian int16, and returns their fraction bits, by the rule of
    /// [`scale`].
    ///
    /// # Errors
    /// Those of `fill`; or this format does not allow a scale.
    pub fn build<E: From<WeightFileError>>(
        &self,
        fill: impl FnOnce(Vec<&mut [u8]>) -> Result<Vec<i16>, E>,
    ) -> Result<BuiltFile, E> {
        let mut file = BuiltFile {
            numbers: 8 + self.header.len(),
            length: self.file_bytes() as usize,
            bytes: vec![0; 8 + self.header.len() + Values::byte_len(self.layout.len)],
        };
        let (front, mut rest) = file
            .bytes
            .split_at_mut(file.numbers + 2 * self.tensors.len());
        let mut places = Vec::with_capacity(self.tensors.len());
        for place in &self.layout.tensors {
            let (tensor, later) = rest.split_at_mut(2 * place.len);
            places.push(tensor);
            rest = later;
        }
        let scales = fill(places)?;
        for ((tensor, limits), bits) in self.tensors.iter().zip(&self.limits).zip(&scales) {
            scale::check_limits(&tensor.name, *bits, *limits)?;
        }
        let (length, front) = front.split_at_mut(8);
        length.copy_from_slice(&(self.header.len() as u64).to_le_bytes());
        let (header, front) = front.split_at_mut(self.header.len());
        header.copy_from_slice(&self.header);
        for (target, bits) in front.chunks_exact_mut(2).zip(scales) {
            target.copy_from_slice(&bits.to_le_bytes());
        }
        Ok(file)
    }

    /// Makes weights of tensors by number.
    ///
    /// # Errors
    /// Those of `tensor`; or this format does not allow a scale.
    pub fn assemble<E: From<WeightFileError>>(
        &self,
        mut tensor: impl FnMut(usize) -> Result<ScaledTensor, E>,
    ) -> Result<QuantisedWeights, E> {
        let mut buffer = vec![0; Values::byte_len(self.layout.len)];
        for (index, place) in self.layout.tensors.iter().enumerate() {
            let ScaledTensor { values, bits } = tensor(index)?;
            buffer[2 * index..][..2].copy_from_slice(&bits.to_le_bytes());
            let target = buffer[2 * place.start..][..2 * place.len].chunks_exact_mut(2);
            for (target, value) in target.zip(values) {
                target.copy_from_slice(&value.to_le_bytes());
            }
        }
        let weights = QuantisedWeights::from_bytes(&self.spec, &buffer);
        Ok(weights.map_err(WeightFileError::from)?)
    }

    fn check_scale(&self, index: usize, values: &[i16], bits: i16) -> Result<(), WeightFileError> {
        scale::check(&self.tensors[index].name, values, bits, self.limits[index])
    }

    fn difference<R: ReadAt>(&self, file: &TensorFile<R>) -> WeightFileError {
        let (mut expected, count) = (self.tensors.iter(), [self.tensors.len()]);
        let different = expected
            .find_map(|tensor| file.check(&tensor.name, Dtype::I16, &tensor.shape).err())
            .or_else(|| file.check(SCALES, Dtype::I16, &count).err());
        if let Some(different) = different {
            return different.into();
        }
        let known = |name: &String| *name == SCALES || self.tensors.iter().any(|t| t.name == *name);
        match file.names().into_iter().find(|name| !known(name)) {
            Some(name) => WeightFileError::Extra(short(&name)),
            None => WeightFileError::OtherHeader,
        }
    }
}

/// A file made by [`Format::build`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BuiltFile {
    /// With the padding in memory.
    bytes: Vec<u8>,
    numbers: usize,
    length: usize,
}

impl BuiltFile {
    /// The bytes of the file.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }

    /// The file.
    pub fn into_bytes(mut self) -> Vec<u8> {
        self.bytes.truncate(self.length);
        self.bytes
    }

    /// Its numbers, as [`QuantisedWeights::as_bytes`].
    pub fn numbers(&self) -> &[u8] {
        &self.bytes[self.numbers..]
    }

    /// The weights in it.
    ///
    /// # Errors
    /// `spec` is not the format's.
    pub fn weights(&self, spec: &EvalSpec) -> Result<QuantisedWeights, WeightFileError> {
        Ok(QuantisedWeights::from_bytes(spec, self.numbers())?)
    }
}

/// An open file, read one tensor at a time.
#[derive(Debug)]
pub struct WeightsFile<'f, R> {
    format: &'f Format,
    file: TensorFile<R>,
    scales: Vec<i16>,
}

impl<R: ReadAt> WeightsFile<'_, R> {
    /// The file's fraction bits. [`Self::tensor`] checks them.
    pub fn scales(&self) -> &[i16] {
        &self.scales
    }

    /// Reads tensor number `index`.
    ///
    /// # Errors
    /// The file cannot be read, or the scale is wrong.
    pub fn tensor(&self, index: usize) -> Result<ScaledTensor, WeightFileError> {
        let TensorSpec { name, shape } = &self.format.tensors[index];
        let (values, bits) = (self.file.read_i16(name, shape)?, self.scales[index]);
        self.format.check_scale(index, &values, bits)?;
        Ok(ScaledTensor { values, bits })
    }
}
