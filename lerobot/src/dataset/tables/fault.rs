//! What is wrong with a parquet file: damage, or something unsupported. Another copy helps only against damage.

use parquet::errors::ParquetError;

#[derive(Debug, PartialEq)]
pub(super) enum ParquetFault {
    /// It contradicts itself or the format.
    Damaged(String),
    /// It may be sound.
    NotSupported(String),
}

impl std::fmt::Display for ParquetFault {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Self::Damaged(cause) => write!(f, "damaged parquet file: {cause}"),
            Self::NotSupported(cause) => write!(
                f,
                "{cause}; this is not supported: write the file anew, for example with pandas"
            ),
        }
    }
}

impl ParquetFault {
    pub fn in_column(self, name: &str) -> Self {
        let within = |cause: String| format!("column {name}: {cause}");
        match self {
            Self::Damaged(cause) => Self::Damaged(within(cause)),
            Self::NotSupported(cause) => Self::NotSupported(within(cause)),
        }
    }
}

impl From<String> for ParquetFault {
    fn from(cause: String) -> Self {
        Self::Damaged(cause)
    }
}

impl From<&str> for ParquetFault {
    fn from(cause: &str) -> Self {
        Self::Damaged(cause.into())
    }
}

impl From<std::io::Error> for ParquetFault {
    fn from(error: std::io::Error) -> Self {
        Self::Damaged(error.to_string())
    }
}

impl From<ParquetError> for ParquetFault {
    fn from(error: ParquetError) -> Self {
        match error {
            ParquetError::NYI(cause) => Self::NotSupported(cause),
            error => Self::Damaged(error.to_string()),
        }
    }
}

impl From<arrow_schema::ArrowError> for ParquetFault {
    fn from(error: arrow_schema::ArrowError) -> Self {
        Self::Damaged(error.to_string())
    }
}
