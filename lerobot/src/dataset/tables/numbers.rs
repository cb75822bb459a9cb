//! Numbers of a column, converted to the requested width.

use std::borrow::Cow;

use arrow_array::cast::AsArray;
use arrow_array::types::{
    Float16Type, Float32Type, Float64Type, Int16Type, Int32Type, Int64Type, Int8Type, UInt16Type,
    UInt32Type, UInt64Type, UInt8Type,
};
use arrow_array::Array;
use arrow_schema::DataType;

/// From here on, float64 skips whole numbers.
const EXACT: f64 = (1u64 << 53) as f64;

pub(super) enum ColumnMisfit {
    /// Not numeric.
    Type,
    /// This number is not whole, or too large.
    Value(String),
}

/// A column's numbers, each through `$f`.
macro_rules! values {
    ($column:expr, $kind:ty, $f:expr) => {
        $column
            .as_primitive::<$kind>()
            .values()
            .iter()
            .map($f)
            .collect()
    };
}

/// Whole numbers, also as floats: pandas makes floats of a column that had gaps.
pub(super) fn ints(column: &dyn Array) -> Result<Cow<'_, [i64]>, ColumnMisfit> {
    let whole = |value: f64| {
        let fits = value.fract() == 0.0 && value.abs() <= EXACT;
        fits.then_some(value as i64)
            .ok_or_else(|| ColumnMisfit::Value(value.to_string()))
    };
    Ok(Cow::Owned(match column.data_type() {
        DataType::Int64 => {
            return Ok(Cow::Borrowed(
                &column.as_primitive::<Int64Type>().values()[..],
            ))
        }
        DataType::Int8 => values!(column, Int8Type, |&v| v.into()),
        DataType::Int16 => values!(column, Int16Type, |&v| v.into()),
        DataType::Int32 => values!(column, Int32Type, |&v| v.into()),
        DataType::UInt8 => values!(column, UInt8Type, |&v| v.into()),
        DataType::UInt16 => values!(column, UInt16Type, |&v| v.into()),
        DataType::UInt32 => values!(column, UInt32Type, |&v| v.into()),
        DataType::UInt64 => {
            let int = |v: &u64| i64::try_from(*v).map_err(|_| ColumnMisfit::Value(v.to_string()));
            let ints: Result<Vec<i64>, _> = values!(column, UInt64Type, int);
            ints?
        }
        DataType::Float16 | DataType::Float32 | DataType::Float64 => doubles(column)?
            .iter()
            .map(|&v| whole(v))
            .collect::<Result<_, _>>()?,
        _ => return Err(ColumnMisfit::Type),
    }))
}

pub(super) fn doubles(column: &dyn Array) -> Result<Cow<'_, [f64]>, ColumnMisfit> {
    Ok(Cow::Owned(match column.data_type() {
        DataType::Float64 => {
            return Ok(Cow::Borrowed(
                &column.as_primitive::<Float64Type>().values()[..],
            ))
        }
        DataType::Float16 => values!(column, Float16Type, |v| v.to_f64()),
        DataType::Float32 => values!(column, Float32Type, |&v| v.into()),
        _ => ints(column)?.iter().map(|&v| v as f64).collect(),
    }))
}

/// Numbers as float32, rounded as in LeRobot.
pub(super) fn floats(column: &dyn Array) -> Result<Cow<'_, [f32]>, ColumnMisfit> {
    Ok(match column.data_type() {
        DataType::Float32 => Cow::Borrowed(&column.as_primitive::<Float32Type>().values()[..]),
        _ => Cow::Owned(doubles(column)?.iter().map(|&v| v as f32).collect()),
    })
}
